"""Message packages as pip packages: a wheel for each, made of its definitions and installed by pip.

The module `build` reads package.xml and makes wheels, `environment` installs and uninstalls wheels.
"""
