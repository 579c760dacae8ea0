"""Generated packages are importable before the first class is made here: a process has one class of a type, and keeps
those it compiled in memory.
"""

import worlds

__all__ = ["worlds"]
