"""Wheels: zip files with metadata, as pip installs them.

Decides that the same contents make the same bytes, at any time and on any machine. A pure Python wheel is little more
than a zip file, and none of the libraries that write one takes files that are not on disk.
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path

_TAG = "py3-none-any"
_EARLIEST = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True, slots=True)
class Wheel:
    """What a wheel holds.

    Attributes:
        name: of the distribution, as people write it.
        metadata: headers of METADATA behind name and version.
        files: contents by path.
        entry_points: text of ``entry_points.txt``.
    """

    name: str
    version: str
    metadata: tuple[tuple[str, str], ...]
    files: dict[str, bytes]
    entry_points: str

    @property
    def file_name(self) -> str:
        """The wheel's name by which pip knows project, version and tags."""
        return f"{self._stem}-{_TAG}.whl"

    @property
    def _stem(self) -> str:
        return f"{normalized(self.name).replace('-', '_')}-{self.version}"

    def write(self, folder: Path) -> Path:
        """Write it into a folder; an older one of the same name is replaced. Raises OSError."""
        folder.mkdir(parents=True, exist_ok=True)
        path, partial = folder / self.file_name, folder / f".{self.file_name}.part"
        try:
            with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
                for name, data in self._all_files():
                    told = zipfile.ZipInfo(name, _date())
                    told.external_attr = 0o100644 << 16
                    told.compress_type = zipfile.ZIP_DEFLATED
                    archive.writestr(told, data)
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)
        return path

    def _all_files(self) -> list[tuple[str, bytes]]:
        info = f"{self._stem}.dist-info"
        headers = (("Metadata-Version", "2.1"), ("Name", self.name), ("Version", self.version), *self.metadata)
        files = [
            *sorted(self.files.items()),
            (f"{info}/METADATA", "".join(f"{key}: {value}\n" for key, value in headers).encode()),
            (
                f"{info}/WHEEL",
                f"Wheel-Version: 1.0\nGenerator: rosidl-py-gen\nRoot-Is-Purelib: true\nTag: {_TAG}\n".encode(),
            ),
            (f"{info}/entry_points.txt", self.entry_points.encode()),
            (
                f"{info}/top_level.txt",
                "".join(f"{top}\n" for top in sorted({n.split("/")[0] for n in self.files})).encode(),
            ),
        ]
        record = "".join(f"{name},{_hash(data)},{len(data)}\n" for name, data in files)
        return [*files, (f"{info}/RECORD", f"{record}{info}/RECORD,,\n".encode())]


def normalized(name: str) -> str:
    """A name as indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def file_hash(data: bytes) -> str:
    """The hash of a file's bytes in the spelling of RECORD."""
    return _hash(data)


def _hash(data: bytes) -> str:
    return "sha256=" + base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


def _date() -> tuple[int, int, int, int, int, int]:
    """SOURCE_DATE_EPOCH, where builds set one; zip files begin with 1980."""
    try:
        told = time.gmtime(int(os.environ["SOURCE_DATE_EPOCH"]))[:6]
    except (KeyError, ValueError, OverflowError, OSError):
        return _EARLIEST
    return max(_EARLIEST, told)
