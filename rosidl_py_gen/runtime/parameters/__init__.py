"""Parameters of a node: their values, who may set them, the services around them, and clients of other nodes.

May import: endpoints and the rooms below.
"""
