"""Loggers of nodes and where their records go: the console, files and /rosout.

May import: names.
"""
