"""Lifecycle nodes: states, transitions, and the services with which peers change the state."""
