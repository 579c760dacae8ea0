"""What ``rosidl-py topic`` does: a module for each command, and what several of them need."""
