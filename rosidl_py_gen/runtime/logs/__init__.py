"""Loggers of nodes, and the outputs of log records: console, log file and /rosout."""
