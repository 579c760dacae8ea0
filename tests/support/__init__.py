"""Helpers that tests share. Modules with a `main` are commands: ``python tools/record_public_api.py``."""
