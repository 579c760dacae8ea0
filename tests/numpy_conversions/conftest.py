"""Generated packages are importable before the first class is made here: a process has one class of a type, and keeps
those it compiled in memory.
"""

from support import node_fixtures

__all__ = ["node_fixtures"]
