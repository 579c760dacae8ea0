"""Message packages as pip packages: a wheel for each, made of its definitions and installed by pip.

`manifest` reads package.xml, `build` makes wheels, `environment` installs and uninstalls them.
"""
