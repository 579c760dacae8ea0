"""Modules that several packages share: names, field types, type descriptions, resources, YAML and JSON.

Imports no other package. Names here are not public; the public ones are exported by `rosidl_py_gen`.
"""
