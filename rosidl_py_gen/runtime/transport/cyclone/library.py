"""Search for the C library of Cyclone DDS, libddsc, and advice on what to install if none is found.

The first candidate that loads and has all of `c_api.REQUIRED_SYMBOLS` is used, and loaded once. If the process loads
another libddsc, each library has its own symbols; participants of the two libraries do not discover each other in the
process.

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
from typing import ClassVar

from rosidl_py_gen.base.resources import install_command
from rosidl_py_gen.runtime.transport.api import BackendMissingError
from rosidl_py_gen.runtime.transport.cyclone.c_api import MIN_VERSION, REQUIRED_SYMBOLS
from rosidl_py_gen.runtime.transport.cyclone.config import OPTIONAL_ELEMENTS

VARIABLE = "ROSIDL_LIBDDSC"
_PATTERN = {"win32": "ddsc*.dll", "darwin": "libddsc*.dylib"}.get(sys.platform, "libddsc*.so*")
_NAMES = {"win32": ("ddsc.dll",), "darwin": ("libddsc.dylib",)}.get(
    sys.platform, ("libddsc.so.11", "libddsc.so.0", "libddsc.so.0debian", "libddsc.so")
)
"""Names of libddsc for the system's loader. The plain name exists only with the headers; Debian's has a suffix."""
_WHEELS = {
    "rosidl_libddsc": ("lib",),
    "cyclonedds": (".dylibs", "../cyclonedds.libs", "../cyclonedds_nightly.libs"),
}
"""Python packages that contain libddsc, and the folder of libddsc in each. cyclonedds has another copy, for compilers.
"""
LIBRARY_COMMAND = "rosidl-py-gen libddsc"
"""Command that installs libddsc from a wheel for another Python version."""
_DEBIAN = "apt install libddsc0debian (Debian from 12, Ubuntu from 24.04, Raspberry Pi OS)"
_SECURITY_SYMBOL = "DDS_Security_Exception_set"
"""Function of libddsc that exists only in builds with DDS Security."""


@dataclass(frozen=True, slots=True)
class LibraryWheel:
    """Wheel of cyclonedds on the package index that contains libddsc for a platform.

    The library works with every Python version, also with others than the version that the wheel is for.
    """

    platform: str
    """Platform tag in the file name of the wheel."""
    sha256: str
    """SHA-256 of the wheel, hexadecimal."""
    member: str
    """Path of libddsc in the wheel."""
    library: str
    """File name of libddsc after it was installed.

    On Windows the name has a version: code that loads ``ddsc.dll`` by name would get the library of this process.
    """

    VERSION: ClassVar[str] = "11.0.1"
    PYTHON: ClassVar[str] = "3.13"

    @property
    def abi(self) -> str:
        """ABI tag of the wheel for pip.

        Without it, pip would select wheels for free-threaded Python when it runs on such a Python.
        """
        return f"cp{self.PYTHON.replace('.', '')}"

    @property
    def file(self) -> str:
        """File name of the wheel."""
        return f"cyclonedds-{self.VERSION}-{self.abi}-{self.abi}-{self.platform}.whl"


_LINUX_LIBRARY, _MAC_LIBRARY = "libddsc-ad12c33a.so.11.0.1", "libddsc.11.0.1.dylib"
_LIBRARY_WHEELS = {
    ("linux", "x86_64"): LibraryWheel(
        "manylinux_2_17_x86_64.manylinux2014_x86_64",
        "fef1f6ce115a579e322f3156842e8b660883e4e8b0aa2f5e2a3df9d7959d1736",
        f"cyclonedds.libs/{_LINUX_LIBRARY}",
        _LINUX_LIBRARY,
    ),
    ("darwin", "arm64"): LibraryWheel(
        "macosx_11_0_arm64",
        "c3b899649685fd2606ea65620ea173b28d61e775adf8785861460ff91efbbbb8",
        f"cyclonedds/.dylibs/{_MAC_LIBRARY}",
        _MAC_LIBRARY,
    ),
    ("darwin", "x86_64"): LibraryWheel(
        "macosx_10_13_x86_64",
        "20b5f2b4c1e42bf3d217f45ba3664dc21a16b74803b8b457e91ea187b11fc7bd",
        f"cyclonedds/.dylibs/{_MAC_LIBRARY}",
        _MAC_LIBRARY,
    ),
    ("win32", "AMD64"): LibraryWheel(
        "win_amd64",
        "850d6624dad8c9f3e0e65423225bd8e4c14c85c2d53bd64e16c2569ea3b491db",
        "cyclonedds.libs/ddsc.dll",
        "ddsc-11.0.1.dll",
    ),
}
"""Wheels that contain libddsc by `sys.platform` and `platform.machine()`; pyproject.toml has the same platforms."""


@dataclass(frozen=True)
class DdscLibrary:
    """Loaded libddsc with all required symbols."""

    handle: ct.CDLL
    file: str
    """Real path of the library; the name that was loaded if the system does not report the path."""

    @property
    def version(self) -> str:
        """Version of Cyclone DDS from the file name, for people; no code depends on it."""
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
        """Members of `config.OPTIONAL_ELEMENTS` that the library does not know.

        A configuration with one of them makes the creation of a domain fail.
        """
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
    """Return the libddsc of this process; the first call searches and loads it.

    Raises:
        BackendMissingError: no usable libddsc was found; the text contains what was tried, and what to install.
    """
    library = _load_cached()
    if isinstance(library, str):
        raise BackendMissingError(library, name="cyclonedds")
    return library


def is_found() -> bool:
    """Return True if a usable libddsc was found; the first call searches and loads it."""
    return isinstance(_load_cached(), DdscLibrary)


@cache
def _load_cached() -> DdscLibrary | str:
    return load(os.environ)


def load(environ: Mapping[str, str]) -> DdscLibrary | str:
    """Load and return the first usable libddsc, or return the text of an error if none is usable.

    With ROS_SECURITY_ENABLE=true, a library with security is preferred.
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
    """Yield paths of libddsc, and names for the system's loader, in the order in which they are tried."""
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
    """Return the real path of a loaded libddsc, or of the libddsc that a loaded library is linked to.

    Returns:
        `name` if the system does not report the path.
    """
    try:
        dladdr = ct.CDLL(None).dladdr
    except (AttributeError, OSError, TypeError):  # Windows
        return name
    info = (ct.c_char_p * 4)()  # Dl_info, which begins with the name of the file
    is_known = dladdr(ct.cast(library["dds_create_participant"], ct.c_void_p), info)
    return os.path.realpath(os.fsdecode(info[0])) if is_known and info[0] else name


def library_wheel() -> LibraryWheel | None:
    """Return the wheel that contains libddsc for this platform; None if there is no such wheel."""
    if sys.platform == "linux" and not _has_glibc():
        return None
    return _LIBRARY_WHEELS.get((sys.platform, platform.machine()))


def has_wheel() -> bool:
    """Return True if cyclonedds has a wheel for this Python and platform; pyproject.toml has the same markers."""
    is_supported = sys.version_info < (3, 14) and sys.implementation.name == "cpython"
    return is_supported and has_gil_build() and library_wheel() is not None


def _has_glibc() -> bool:
    """Return True if Linux uses glibc, which the wheels need, and not musl."""
    try:
        return (os.confstr("CS_GNU_LIBC_VERSION") or "").startswith("glibc")
    except (OSError, ValueError):
        return False


def has_gil_build() -> bool:
    """Return True unless this is a free-threaded Python, which has wheels of its own kind."""
    import sysconfig

    return not sysconfig.get_config_var("Py_GIL_DISABLED")


def security_advice() -> str:
    """Return advice for people on how to get a libddsc with DDS Security on this system."""
    if sys.platform == "linux":
        return (
            f"use a libddsc with security: {_DEBIAN}, then {VARIABLE}=libddsc.so.0debian; or source a ROS installation "
            f"with rmw_cyclonedds; or name another one in {VARIABLE}"
        )
    return f"build Cyclone DDS with OpenSSL (ENABLE_SECURITY), and name its library in {VARIABLE}"


def install_advice() -> str:
    """Return the command that installs libddsc, or other advice for people on this system."""
    if has_wheel():
        return install_command("node")
    if library_wheel() is not None:
        return LIBRARY_COMMAND
    name_one = f"name a libddsc in {VARIABLE}"
    if sys.platform != "linux":
        return f"build Cyclone DDS for this platform, which has no wheel of it, and {name_one}"
    if not _has_glibc():
        return f"build Cyclone DDS for this system, which does not use glibc, and {name_one}"
    return f"{_DEBIAN}, or source a ROS installation with rmw_cyclonedds, or {name_one}"
