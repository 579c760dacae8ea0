"""Nodes with managed states, and the services by which others change them.

May import: endpoints, the rooms below, and node.
"""
