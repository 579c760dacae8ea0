"""What ``rosidl-py lifecycle`` does: a module for each command."""
