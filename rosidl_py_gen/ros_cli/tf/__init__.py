"""Command group ``rosidl-py tf``."""
