"""Lifecycle nodes: states, transitions, and the services by which peers change them."""
