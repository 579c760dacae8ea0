"""Code generation from checked definitions: layout plan, encoder and decoder, template.

The entry point is the module `module_sources`.
"""
