"""Command ``rosidl-py prefix``: an ament prefix of source packages, made without a build."""
