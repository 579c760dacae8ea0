"""Command group ``rosidl-py topic``."""
