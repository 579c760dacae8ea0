"""From interface text to a resolved model with type hashes. Never imports the generator's output or the runtime."""
