"""Conversions between messages and numpy arrays, `datetime` and rotations, without copying where that is possible.

Functions accept any object that has the fields of the message: generated, compiled in memory or of another library.
Functions that make a message take its class as `cls`. Without it they use the class that `get_message` returns, which
type checkers cannot know.

In a notebook, this import or ``%load_ext rosidl_py_gen.numpy`` makes IPython display messages as pictures or trees,
bags as tables of their topics, and nodes as lists of their entities.
"""

from rosidl_py_gen.cdr.lazy import stub_exports
from rosidl_py_gen.numpy.notebook import register_if_running as _register_if_running

__getattr__, __dir__, __all__ = stub_exports(__name__)
_register_if_running()
