"""From interface definitions to Python modules: `spec` reads and resolves them, `codegen` writes classes.

`generate` runs both over folders. Imports no runtime: a base install generates, encodes and decodes.
"""
