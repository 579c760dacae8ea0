"""Command group ``rosidl-py bag``."""
