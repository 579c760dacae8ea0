"""Import hook for generated packages, active before the first class is made: a process has one class for a type."""

from support import node_fixtures

__all__ = ["node_fixtures"]
