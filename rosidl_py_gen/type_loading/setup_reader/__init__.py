"""Reader of setup.py, setup.cfg and pyproject.toml of a package, which runs none of them."""
