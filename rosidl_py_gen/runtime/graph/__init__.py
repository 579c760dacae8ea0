"""Which nodes, topics and services there are: what DDS discovers and what nodes tell of themselves.

May import: names, logs, transport, loop.
"""
