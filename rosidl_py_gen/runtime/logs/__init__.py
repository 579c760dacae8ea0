"""Loggers of nodes, and their outputs: the console, files and /rosout."""
