"""Modules that several packages share: names, field types, type descriptions, resources, YAML and JSON.

The package `base` imports no other package of the product. Its names are not public; `rosidl_py_gen` exports the public
ones.
"""
