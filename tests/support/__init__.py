"""Helpers that tests share. Those with a `main` are commands: ``python tests/support/record_public_api.py``."""
