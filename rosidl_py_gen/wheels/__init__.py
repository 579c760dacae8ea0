"""Message packages as pip packages: each package becomes a wheel, made of its definitions and installed by pip.

The module `build` reads package.xml and makes wheels, `environment` installs and uninstalls wheels.
"""
