"""Code generation from checked definitions: layout plan, encoder and decoder, template.

The entry point is the module `module_sources`.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
