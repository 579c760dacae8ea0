"""Message packages as pip packages: a wheel for each, made of its definitions, and installed or taken back by pip.

`manifest` reads package.xml, `build` makes wheels, `environment` installs and uninstalls them. Needs the compiler;
nothing here is imported by generated code.
"""
