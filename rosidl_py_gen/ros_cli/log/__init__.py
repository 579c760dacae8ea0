"""Command ``rosidl-py log``."""
