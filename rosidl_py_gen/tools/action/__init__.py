"""What ``rosidl-py action`` does: a module for each command."""
