"""Classes for types at run time: by name, or from what another node says of a type.

`by_name` finds them or compiles definitions, `from_description` compiles descriptions, which `cache` keeps.
"""
