"""The C library of Eclipse Cyclone DDS, one file, for `ctypes`.

rosidl-py-gen finds it without importing this package. The library is under the terms of Cyclone DDS, EPL-2.0 or
EDL-1.0, whose texts are among the files of the distribution; so are these lines.
"""

from importlib.metadata import version
from pathlib import Path

__version__ = version("rosidl-libddsc")  # that of Cyclone DDS


def path() -> Path:
    """The file to load."""
    (library,) = Path(__file__).with_name("lib").iterdir()
    return library
