"""Code generation from checked definitions: layout plan, encoder and decoder, template. Enter by `module_sources`."""
