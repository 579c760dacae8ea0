"""Names of nodes, topics and parameters: what is allowed, how remapping changes them, how DDS spells them.

Imports no other room.
"""
