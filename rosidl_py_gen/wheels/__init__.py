"""Message packages as pip packages: a wheel for each, made of its definitions and installed by pip.

`build` reads package.xml and makes wheels, `environment` installs and uninstalls them.
"""
