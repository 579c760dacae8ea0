"""Compiler from interface definitions to Python modules.

`frontend` reads and checks definitions, `codegen` generates classes, `generate` runs both for folders, `compatibility`
compares definitions. Imports no runtime: a base installation generates, encodes and decodes.
"""
