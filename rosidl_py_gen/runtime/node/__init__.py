"""Nodes and contexts: arguments, environment, clock, and the services that every node has."""
