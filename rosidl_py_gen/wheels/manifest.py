"""What a package.xml says of a package, as far as a pip package says it too.

Decides that a manifest is data of strangers: no entities, no more than a megabyte, and what becomes a line of metadata
is one line.
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
        version: as pip takes it.
        maintainers: ``name <address>``, or one of both.
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
    """The manifest of a package in `folder`.

    Raises:
        DefinitionError: there is none, it is no XML, or says no version that pip takes.
    """
    path = folder / "package.xml"
    try:
        with path.open("rb") as file:
            data = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise _problem(path, f"cannot be read: {error.strerror}; a wheel has its name and version from there") from None
    if len(data) > _MAX_BYTES:
        raise _problem(path, f"more than {_MAX_BYTES} bytes")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise _problem(path, "document types and entities are not read; package.xml needs none")
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
