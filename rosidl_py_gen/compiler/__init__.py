"""Compiler from interface definitions to Python modules.

`frontend` reads and checks definitions, `codegen` generates classes, `generate` runs both for folders. The compiler
does not import the runtime: a base installation can generate classes, encode and decode.
"""
