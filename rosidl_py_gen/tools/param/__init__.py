"""What ``rosidl-py param`` does: a module for each command."""
