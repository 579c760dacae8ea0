"""Transforms between coordinate frames: a buffer fed by ``/tf`` and ``/tf_static``, and broadcasters.

Transforms and errors are the same as in tf2.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
