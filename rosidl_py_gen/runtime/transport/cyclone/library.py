"""Finds and loads the C library of Cyclone DDS, libddsc, or states what to install.

The first candidate that loads and has all of `c_api.REQUIRED_SYMBOLS` is used. It is loaded once. Another libddsc in
this process has its own symbols; the two do not discover each other in the process.

Source: docs/internals/dds.md 7.
"""

from __future__ import annotations

import ctypes as ct
import ctypes.util
import os
import platform
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

from rosidl_py_gen.base.resources import install_command
from rosidl_py_gen.runtime.transport.api import BackendMissingError
from rosidl_py_gen.runtime.transport.cyclone.c_api import MIN_VERSION, REQUIRED_SYMBOLS
from rosidl_py_gen.runtime.transport.cyclone.config import OPTIONAL_ELEMENTS

VARIABLE = "ROSIDL_LIBDDSC"
_PATTERN = {"win32": "ddsc*.dll", "darwin": "libddsc*.dylib"}.get(sys.platform, "libddsc*.so*")
_NAMES = {"win32": ("ddsc.dll",), "darwin": ("libddsc.dylib",)}.get(
    sys.platform, ("libddsc.so.11", "libddsc.so.0", "libddsc.so.0debian", "libddsc.so")
)
"""Names for the loader. The plain name exists only with the headers, and that of Debian has a special suffix."""
_WHEELS = {
    "rosidl_libddsc": ("lib", "../rosidl_libddsc.libs"),
    "cyclonedds": (".dylibs", "../cyclonedds.libs", "../cyclonedds_nightly.libs"),
}
"""Packages that contain the library, and the folders. cyclonedds has another copy elsewhere, for compilers."""
_DEBIAN = "apt install libddsc0debian (Debian from 12, Ubuntu from 24.04, Raspberry Pi OS)"
_SECURITY_SYMBOL = "DDS_Security_Exception_set"
"""Function that exists only in builds with DDS Security."""


@dataclass(frozen=True)
class DdscLibrary:
    """Loaded libddsc with all required symbols."""

    handle: ct.CDLL
    file: str
    """Real path of the library; the name that was loaded if the system does not report the path."""

    @property
    def version(self) -> str:
        """Version from the file name, for people; no code depends on it."""
        match = re.search(r"(\d+\.\d+[\w.]*?)(\.dylib)?$", Path(self.file).name)
        return match[1] if match else "of unknown version"

    def __str__(self) -> str:
        return f"Cyclone DDS {self.version}, {self.file}"

    @property
    def has_security(self) -> bool:
        """True if the library was built with DDS Security."""
        return hasattr(self.handle, _SECURITY_SYMBOL)

    @cached_property
    def unsupported_elements(self) -> frozenset[str]:
        """Members of `config.OPTIONAL_ELEMENTS` that the library does not know; one of them makes a domain fail."""
        missing, last = OPTIONAL_ELEMENTS, b""
        try:
            with open(self.file, "rb") as file:
                while missing and (block := file.read(1 << 20)):  # the whole file would take 8 ms
                    content = last + block
                    missing = frozenset(name for name in missing if name.encode() + b"\0" not in content)
                    last = block[-100:]  # a name may be in two blocks
        except OSError:
            return OPTIONAL_ELEMENTS
        return missing


def find() -> DdscLibrary:
    """Return the library of this process.

    Raises:
        BackendMissingError: no library was found; the text contains what was tried, and what to install.
    """
    library = _load_cached()
    if isinstance(library, str):
        raise BackendMissingError(library, name="cyclonedds")
    return library


def is_found() -> bool:
    """Return True if the library was found."""
    return isinstance(_load_cached(), DdscLibrary)


@cache
def _load_cached() -> DdscLibrary | str:
    return load(os.environ)


def load(environ: Mapping[str, str]) -> DdscLibrary | str:
    """Return the first usable candidate, or the text of the error.

    With ROS_SECURITY_ENABLE=true, a library with security precedes those without it.
    """
    tried, without_security = [], None
    for name in candidates(environ):
        try:
            library = ct.CDLL(name)
        except OSError as error:
            # Most candidates do not exist, and the loader has several texts for that.
            tried.append(f"{name}: {error}" if os.path.exists(name) else f"{name}: not found")
            continue
        missing = [symbol for symbol in REQUIRED_SYMBOLS if not hasattr(library, symbol)]
        if not missing:
            found = DdscLibrary(library, file_of(library, name))
            if found.has_security or environ.get("ROS_SECURITY_ENABLE") != "true":
                return found
            without_security = without_security or found
            continue
        reason = f"it lacks {missing[0]}, which Cyclone DDS has from {MIN_VERSION} on"
        tried.append(f"{name}: {'it is not a libddsc' if 'dds_create_participant' in missing else reason}")
    if without_security is not None:
        return without_security
    is_set = environ.get(VARIABLE)
    only = f" {VARIABLE} is set, so nothing else was tried." if is_set else ""
    fix = f"Correct {VARIABLE}, or unset it" if is_set else f"To install it: {install_advice()}"
    return (
        f"DDS needs the C library of Cyclone DDS, libddsc, and none was found.{only} MemoryTransport works without it. "
        f"Tried: {'; '.join(tried)}. {fix}"
    )


def candidates(environ: Mapping[str, str]) -> Iterator[str]:
    """Yield paths, and names for the loader, in the order in which they are tried."""
    if environ.get(VARIABLE):
        yield environ[VARIABLE]
        return
    for package, folders in _WHEELS.items():
        spec = find_spec(package)
        for path in (spec.submodule_search_locations or ()) if spec else ():
            yield from chain(*(_files(Path(path), folder) for folder in folders))
    installed = filter(None, environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    for prefix in chain(map(Path, installed), sorted(Path("/opt/ros").glob("*"))):
        yield from chain(*(_files(prefix, folder) for folder in ("lib", "lib/*", "bin")))
    yield from _NAMES
    if found := ctypes.util.find_library("ddsc"):  # slow: runs ldconfig or a compiler
        yield found


def _files(below: Path, folder: str) -> list[str]:
    return sorted(os.path.normpath(file) for file in below.glob(f"{folder}/{_PATTERN}"))


def file_of(library: ct.CDLL, name: str) -> str:
    """Return the real path of the libddsc that a handle leads to; `name` if the system does not report it."""
    try:
        dladdr = ct.CDLL(None).dladdr
    except (AttributeError, OSError, TypeError):  # Windows
        return name
    info = (ct.c_char_p * 4)()  # Dl_info, which begins with the name of the file
    is_known = dladdr(ct.cast(library["dds_create_participant"], ct.c_void_p), info)
    return os.path.realpath(os.fsdecode(info[0])) if is_known and info[0] else name


def has_wheel() -> bool:
    """Return True if cyclonedds has a wheel for this Python; pyproject.toml has the same markers."""
    system, machine = sys.platform, platform.machine()
    return (
        sys.version_info < (3, 14)
        and sys.implementation.name == "cpython"
        and (system == "darwin" or (system, machine) in (("linux", "x86_64"), ("win32", "AMD64")))
    )


def security_advice() -> str:
    """Return how to get a library with DDS Security on this system."""
    if sys.platform == "linux":
        return (
            f"use a libddsc with security: {_DEBIAN}, then {VARIABLE}=libddsc.so.0debian; or source a ROS installation "
            f"with rmw_cyclonedds; or name another one in {VARIABLE}"
        )
    return f"build Cyclone DDS with OpenSSL (ENABLE_SECURITY), and name its library in {VARIABLE}"


def install_advice() -> str:
    """Return the command that installs the library, or other advice for this system."""
    if has_wheel():
        return install_command("node")
    if sys.platform == "linux":
        return f"{_DEBIAN}, or source a ROS installation with rmw_cyclonedds, or name a libddsc in {VARIABLE}"
    return f"a CPython from 3.10 to 3.13, which has a wheel of cyclonedds; or name a libddsc in {VARIABLE}"
