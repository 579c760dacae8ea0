"""Front end of the compiler: from definition files to checked interfaces."""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
