"""Names of nodes, topics and parameters: what is allowed, how remapping changes them.

Imports no other room.
"""
