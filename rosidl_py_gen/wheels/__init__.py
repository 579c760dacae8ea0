"""Message packages as pip packages: each package becomes a wheel, made of its definitions and installed by pip.

The module `build` reads package.xml and makes wheels, `environment` installs and uninstalls wheels.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
