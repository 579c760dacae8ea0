"""What ``rosidl-py service`` does: a module for each command."""
