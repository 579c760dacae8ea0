"""What ``rosidl-py node`` does: a module for each command."""
