"""What ``rosidl-py log`` does: what nodes log, live and out of bags."""
