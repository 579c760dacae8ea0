"""The node and the context it lives in: arguments, environment, clock, and the services every node has.

May import: all rooms but lifecycle.
"""
