"""Metadata of a package.xml for a pip package.

A manifest is untrusted: entities are refused, the size is limited, and a value of the metadata is one line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from rosidl_py_gen.errors import DefinitionError, Diagnostic

_MAX_BYTES = 1 << 20
_VERSION = re.compile(r"\d+(\.\d+){0,3}((a|b|rc)\d+)?(\.post\d+)?(\.dev\d+)?")
_DEPENDS = ("depend", "build_depend", "exec_depend", "build_export_depend")


@dataclass(frozen=True, slots=True)
class PackageManifest:
    """A package.xml.

    Attributes:
        version: a valid version for pip.
        maintainers: ``name <address>``, name or address of each.
        depends: names of packages.
    """

    name: str
    version: str
    description: str = ""
    license: str = ""
    maintainers: tuple[str, ...] = ()
    urls: tuple[tuple[str, str], ...] = ()
    depends: tuple[str, ...] = ()


def read_manifest(folder: Path, name: str) -> PackageManifest:
    """Return the manifest of a package in a folder.

    Raises:
        DefinitionError: there is none, it is not XML, or has no valid version for pip.
    """
    path = folder / "package.xml"
    try:
        with path.open("rb") as file:
            data = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise _problem(path, f"cannot be read: {error.strerror}; a wheel needs its name and version") from None
    if len(data) > _MAX_BYTES:
        raise _problem(path, f"more than {_MAX_BYTES} bytes")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise _problem(path, "document types and entities are not supported; package.xml needs none")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise _problem(path, f"not XML: {error}") from None
    version = _line(root.findtext("version"))
    if not _VERSION.fullmatch(version):
        raise _problem(path, f'the version is "{version[:80]}"; pip needs one such as 1.2.3')
    return PackageManifest(
        name,
        version,
        _line(root.findtext("description")),
        " AND ".join(_line(one.text) for one in root.findall("license")),
        tuple(_person(one) for one in root.findall("maintainer")),
        tuple((one.get("type") or "website", _line(one.text)) for one in root.findall("url")),
        tuple(_line(one.text) for tag in _DEPENDS for one in root.findall(tag)),
    )


def _line(text: str | None) -> str:
    return " ".join((text or "").split())


def _person(element: ElementTree.Element) -> str:
    name, address = _line(element.text), _line(element.get("email"))
    return f"{name} <{address}>" if name and address else name or address


def _problem(path: Path, text: str) -> DefinitionError:
    return DefinitionError(Diagnostic(str(path), 0, 0, text))
