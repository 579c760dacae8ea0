"""Lookup and loading of classes at run time: by name, by definition, or by another node's type description.

`class_lookup` finds classes or compiles definitions, `from_description` compiles type descriptions, which `disk_cache`
stores, and `import_hook` makes message packages importable without generated files.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
