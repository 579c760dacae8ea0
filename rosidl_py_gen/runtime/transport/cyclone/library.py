"""Which libddsc is used: where one is looked for, what makes it one, and what to install where there is none.

The first that loads and has every function of `functions.NEEDED` wins. It is loaded once, and its symbols stay apart
from those of another libddsc in this process, which is another world of DDS then.

Source: docs/internals/dds.md 7.
"""

from __future__ import annotations

import ctypes as ct
import ctypes.util
import os
import platform
import re
import sys
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.base.resources import install_command
from rosidl_py_gen.runtime.transport.api import BackendMissingError
from rosidl_py_gen.runtime.transport.cyclone.c_api import NEEDED, OLDEST
from rosidl_py_gen.runtime.transport.cyclone.config import ELEMENTS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

VARIABLE = "ROSIDL_LIBDDSC"
_PATTERN = {"win32": "ddsc*.dll", "darwin": "libddsc*.dylib"}.get(sys.platform, "libddsc*.so*")
_NAMES = {"win32": ("ddsc.dll",), "darwin": ("libddsc.dylib",)}.get(
    sys.platform, ("libddsc.so.11", "libddsc.so.0", "libddsc.so.0debian", "libddsc.so")
)
"""For the loader. The plain one is only where there are headers, too, and Debian's has a suffix of its own."""
_WHEELS = {
    "rosidl_libddsc": ("lib", "../rosidl_libddsc.libs"),
    "cyclonedds": (".dylibs", "../cyclonedds.libs", "../cyclonedds_nightly.libs"),
}
"""Packages that bring the library, and where they have it. Beside these cyclonedds has another copy, for compilers."""


@dataclass(frozen=True)
class DdscLibrary:
    """One that has all we need.

    Attributes:
        file: its real name; where the system does not tell, the one it was asked for by.
    """

    handle: ct.CDLL
    file: str

    @property
    def version(self) -> str:
        """For people only; nothing depends on it."""
        found = re.search(r"(\d+\.\d+[\w.]*?)(\.dylib)?$", Path(self.file).name)
        return found[1] if found else "of unknown version"

    def __str__(self) -> str:
        return f"Cyclone DDS {self.version}, {self.file}"

    @cached_property
    def unsupported_elements(self) -> frozenset[str]:
        """Elements of a configuration, of those in `config.ELEMENTS`, that it does not know: one ends the domain."""
        try:
            content = Path(self.file).read_bytes()
        except OSError:
            return ELEMENTS
        return frozenset(name for name in ELEMENTS if name.encode() + b"\0" not in content)


def find() -> DdscLibrary:
    """The library of this process.

    Raises:
        BackendMissingError: there is none; it says what was tried, and what to install.
    """
    found = _load_cached()
    if isinstance(found, str):
        raise BackendMissingError(found, name="cyclonedds")
    return found


def is_found() -> bool:
    """Whether there is one."""
    return isinstance(_load_cached(), DdscLibrary)


@cache
def _load_cached() -> DdscLibrary | str:
    return load(os.environ)


def load(environ: Mapping[str, str]) -> DdscLibrary | str:
    """The first one that will do, or why there is none."""
    tried = []
    for name in candidates(environ):
        try:
            library = ct.CDLL(name)
        except OSError as error:
            # Most are simply not there, which the loader says of each in its own words.
            tried.append(f"{name}: {error}" if os.path.exists(name) else f"{name}: not found")
            continue
        missing = [one for one in NEEDED if not hasattr(library, one)]
        if not missing:
            return DdscLibrary(library, _file_of(library, name))
        what = f"it lacks {missing[0]}, which Cyclone DDS has from {OLDEST} on"
        tried.append(f"{name}: {'it is no libddsc' if 'dds_create_participant' in missing else what}")
    named = environ.get(VARIABLE)
    only = f" {VARIABLE} is set, so that nothing else was tried." if named else ""
    help_ = f"Correct {VARIABLE}, or unset it" if named else f"To install it: {install_advice()}"
    return (
        f"DDS needs the C library of Cyclone DDS, libddsc, and none was found.{only} MemoryTransport works without it. "
        f"Tried: {'; '.join(tried)}. {help_}"
    )


def candidates(environ: Mapping[str, str]) -> Iterator[str]:
    """Paths, and names for the loader, in the order in which they are tried."""
    if environ.get(VARIABLE):
        yield environ[VARIABLE]
        return
    for package, folders in _WHEELS.items():
        spec = find_spec(package)
        for place in (spec.submodule_search_locations or ()) if spec else ():
            yield from chain(*(_files(Path(place), folder) for folder in folders))
    installed = filter(None, environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    for prefix in chain(map(Path, installed), sorted(Path("/opt/ros").glob("*"))):
        yield from chain(*(_files(prefix, folder) for folder in ("lib", "lib/*", "bin")))
    yield from _NAMES
    found = ctypes.util.find_library("ddsc")  # asks ldconfig or a compiler, which takes its time
    if found:
        yield found


def _files(below: Path, folder: str) -> list[str]:
    return sorted(os.path.normpath(file) for file in below.glob(f"{folder}/{_PATTERN}"))


def _file_of(library: ct.CDLL, name: str) -> str:
    """Which file was loaded, whatever name it was asked for by."""
    try:
        tell = ct.CDLL(None).dladdr
    except (AttributeError, OSError, TypeError):  # Windows
        return name
    told = (ct.c_char_p * 4)()  # Dl_info, which begins with the name of the file
    is_known = tell(ct.cast(library["dds_create_participant"], ct.c_void_p), told)
    return os.path.realpath(os.fsdecode(told[0])) if is_known and told[0] else name


def has_wheel() -> bool:
    """Whether there is a wheel of cyclonedds for this Python; the markers in pyproject.toml say the same."""
    system, machine = sys.platform, platform.machine()
    return (
        sys.version_info < (3, 14)
        and sys.implementation.name == "cpython"
        and (system == "darwin" or (system, machine) in (("linux", "x86_64"), ("win32", "AMD64")))
    )


def install_advice() -> str:
    """The command, or what else helps here."""
    if has_wheel():
        return install_command("node")
    if sys.platform == "linux":
        return (
            "apt install libddsc0debian (Debian from 12, Ubuntu from 24.04, Raspberry Pi OS), or source a ROS "
            f"installation with rmw_cyclonedds, or name a libddsc in {VARIABLE}"
        )
    return f"a CPython from 3.10 to 3.13, which has a wheel of cyclonedds; or name a libddsc in {VARIABLE}"
