"""Installation of the C library of Cyclone DDS (libddsc) for Python versions that cyclonedds has no wheel for.

The library does not depend on the version of Python. pip or uv downloads the wheel of cyclonedds for another version
from the user's package index, and checks its SHA-256 against the recorded one. The library is then packed into a wheel
of its own, ``rosidl-libddsc``, and installed into this environment.

Source: docs/internals/dds.md 7.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from zipfile import BadZipFile, ZipFile

from rosidl_py_gen.errors import OutputError
from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.wheels.build import write_wheel
from rosidl_py_gen.wheels.environment import Installer

if TYPE_CHECKING:
    import os

_PACKAGE = "rosidl_libddsc"
_LICENSE = f"cyclonedds-{library.LibraryWheel.VERSION}.dist-info/licenses/LICENSE"
_MAX_WHEEL_BYTES = 64 << 20
"""Maximum number of bytes read from a wheel that the user gives as a file; wheels of cyclonedds have at most 8 MB."""
_MAX_CAUSE_CHARS = 400
_INIT = '''"""C library of Cyclone DDS, taken from the wheel of cyclonedds {version} for this platform."""
'''


@dataclass(frozen=True, slots=True)
class InstalledLibrary:
    """C library of Cyclone DDS that has been installed into this environment.

    Attributes:
        version: version of Cyclone DDS.
        wheel: file name of the wheel that contained the library.
        path: path of the library in this environment.
    """

    version: str
    wheel: str
    path: str

    @property
    def text(self) -> str:
        """Text about the installed library: version, wheel and path, in one line."""
        return f"installed libddsc {self.version}, from {self.wheel}: {self.path}"

    @classmethod
    def install(cls, file: str | os.PathLike[str] | None = None) -> InstalledLibrary:
        """Install libddsc into this environment: from `file`, a wheel of cyclonedds, or else from the package index.

        Raises:
            OutputError: no wheel is recorded for this platform, the wheel has another SHA-256 than recorded, the
                package index cannot be reached, pip and uv are missing, or the library does not load.
        """
        wheel = library.library_wheel()
        if wheel is None:
            raise OutputError(
                f"libddsc: no wheel of cyclonedds is recorded for this platform; {library.install_advice()}"
            )
        installer = Installer.of_environment()
        with TemporaryDirectory(prefix="rosidl-py-gen-libddsc-") as folder:
            content, terms = fetch(wheel, Path(folder)) if file is None else read(wheel, Path(file))
            built = build(wheel, content, terms, Path(folder))
            installer.install(built)
        return cls(wheel.VERSION, wheel.file, _check(wheel))

    @classmethod
    def install_missing(cls) -> InstalledLibrary | None:
        """Install libddsc if it is missing, cyclonedds has no wheel for this Python, and another wheel is known.

        Returns None if nothing was installed. Raises `OutputError` as `install` does.
        """
        is_needed = not library.has_wheel() and library.library_wheel() is not None and not library.is_found()
        return cls.install() if is_needed else None


def fetch(wheel: library.LibraryWheel, folder: Path) -> tuple[bytes, bytes]:
    """Download a wheel of cyclonedds by pip or uv, and return the bytes of libddsc and of the licence in it.

    Raises `OutputError` if the download fails or the wheel lacks a file.
    """
    requirements, target = folder / "requirements.txt", folder / "wheel"
    installer = Installer.of_environment()
    if installer.name == "uv" and not library.has_gil_build():
        raise OutputError(
            "libddsc: uv selects only wheels for a free-threaded Python here, and cyclonedds has none; expected pip, "
            f"which can select others: `uv pip install pip`, then `{library.LIBRARY_COMMAND}`"
        )
    requirements.write_text(f"cyclonedds=={wheel.VERSION} --hash=sha256:{wheel.sha256}\n", encoding="utf-8")
    try:
        installer.unpack(requirements, target, wheel.PYTHON, wheel.abi, wheel.platform)
    except OutputError as error:
        raise OutputError(
            f"libddsc: {_cause(str(error), wheel)}; check the settings of the index, or get {wheel.file} in another "
            f"way and run `{library.LIBRARY_COMMAND} --from {wheel.file}`"
        ) from None
    try:
        return (target / wheel.member).read_bytes(), (target / _LICENSE).read_bytes()
    except OSError as error:
        raise OutputError(f"libddsc: {wheel.file} has no {error.filename}; expected {wheel.member}") from error


def _cause(output: str, wheel: library.LibraryWheel) -> str:
    """Return the cause of a failed download in one line, extracted from the output of pip or uv."""
    digests = [one for one in re.findall(r"\b[0-9a-f]{64}\b", output) if one != wheel.sha256]
    if "hash" in output.lower() and digests:
        return f"{wheel.file} of the package index has the SHA-256 {digests[-1]}; expected {wheel.sha256}"
    lines = re.findall(r"^\s*(?:.*failed: )?(?:ERROR|error|cause): *(.+?)\s*$", output, re.MULTILINE)
    first, last = (lines[0], lines[-1]) if lines else (output.split("\n")[0], "")
    reason = first if last in first else f"{first}: {last}"
    return f"the package index cannot be reached or has no {wheel.file}: {reason[:_MAX_CAUSE_CHARS]}"


def read(wheel: library.LibraryWheel, file: Path) -> tuple[bytes, bytes]:
    """Return the bytes of libddsc and of the licence in a wheel of cyclonedds on disk.

    Raises `OutputError` if `file` cannot be read or has another SHA-256 than recorded.
    """
    try:
        with file.open("rb") as opened:
            found = hashlib.sha256(opened.read(_MAX_WHEEL_BYTES)).hexdigest()
            if found != wheel.sha256:
                raise OutputError(
                    f"{file}: the SHA-256 is {found}; expected {wheel.sha256} of {wheel.file}, which "
                    f"`pip download --no-deps --only-binary=:all: --python-version {wheel.PYTHON} --abi {wheel.abi} "
                    f"--platform {wheel.platform.split('.')[0]} cyclonedds=={wheel.VERSION}` downloads"
                )
            with ZipFile(opened) as archive:
                return archive.read(wheel.member), archive.read(_LICENSE)
    except OSError as error:
        raise OutputError(f"{file}: {error.strerror or error}; expected a wheel named {wheel.file}") from error
    except (BadZipFile, KeyError) as error:
        raise OutputError(f"{file}: {error}; expected a wheel with {wheel.member}") from error


def build(wheel: library.LibraryWheel, content: bytes, terms: bytes, folder: Path) -> Path:
    """Write the wheel ``rosidl-libddsc`` into a folder and return its path.

    Args:
        wheel: wheel of cyclonedds from which the library was taken.
        content: bytes of the library.
        terms: bytes of the licence of Cyclone DDS.
    """
    files = {
        f"{_PACKAGE}/__init__.py": _INIT.format(version=wheel.VERSION).encode(),
        f"{_PACKAGE}/lib/{wheel.library}": content,
        f"{_PACKAGE}/LICENSE": terms,
    }
    metadata: dict[str, object] = {
        "name": _PACKAGE.replace("_", "-"),
        "version": wheel.VERSION,
        "summary": "C library of Eclipse Cyclone DDS, taken from a wheel of cyclonedds",
        "license": "EPL-2.0 OR BSD-3-Clause",
        "requires_python": ">=3.10",
    }
    return write_wheel(folder, _PACKAGE, files, metadata)


def _check(wheel: library.LibraryWheel) -> str:
    """Load the newly installed library libddsc, and return its path; raises `OutputError` if it cannot be loaded."""
    import importlib

    importlib.invalidate_caches()
    found = library.load({})  # not cached: it failed before the installation
    if isinstance(found, str):
        raise OutputError(f"libddsc: the library of {wheel.file} was installed, but does not load: {found}")
    return found.file
