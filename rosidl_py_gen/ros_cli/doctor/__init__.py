"""Command ``rosidl-py doctor``."""
