"""Helpers that tests share. Modules with a `main` are commands: ``python tests/support/record_public_api.py``."""
