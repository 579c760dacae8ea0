"""Reader of a package's setup.py, setup.cfg and pyproject.toml that does not run any of them."""
