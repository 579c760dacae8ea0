"""Message packages as pip packages: a wheel for each, made of its definitions, and installed or taken back by pip.

`manifest` reads package.xml, `build` decides what goes into wheels, `wheel` writes them, `environment` is about those
that are installed. Needs the compiler; nothing here is imported by generated code.
"""
