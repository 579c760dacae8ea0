"""Wheels of message packages, built by flit_core.

A wheel contains a whole package: the generated code, ``py.typed``, package.xml and the definitions, from which
dependent packages can be generated. Code of a package contains the layout of nested messages of other packages, so a
wheel requires exactly the versions that it was made with. A package that is installed as a wheel is not made again.

Equal contents give equal bytes with the same version of flit_core.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rosidl_py_gen import __version__
from rosidl_py_gen.base.resources import InstalledInterfaces
from rosidl_py_gen.base.xml_reader import XmlElement
from rosidl_py_gen.compiler.generate import generate
from rosidl_py_gen.errors import DefinitionError, Diagnostic

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from rosidl_py_gen.compiler.frontend import Package, SearchPath

_IMPORT = re.compile(r"^\s*(?:from|import) +([A-Za-z_][A-Za-z0-9_]*)[. ]", re.MULTILINE)
_EARLIEST = (1980, 1, 1, 0, 0, 0)
"""Modification time of the files in a wheel if SOURCE_DATE_EPOCH is not set: the first time that zip can store."""
_VERSION = re.compile(r"\d+(\.\d+){0,3}((a|b|rc)\d+)?(\.post\d+)?(\.dev\d+)?")


@dataclass(frozen=True, slots=True)
class BuiltWheel:
    """Wheel file that was written: name of its distribution, path, and requirements."""

    package: str
    path: Path
    requires: tuple[str, ...]


def _selected(search: SearchPath, wanted: list[str]) -> list[str]:
    """Return the names of the packages of which wheels are made: `wanted`, else the packages of the user's folders,
    else all.

    Raises `DefinitionError` if a wanted package is not on the search path.
    """
    for name in wanted:
        if name not in search.packages:
            known = ", ".join(search.packages)[:300]
            raise DefinitionError(Diagnostic(name, 0, 0, f"there is no package of this name; expected one of {known}"))
    own = [name for name, one in search.packages.items() if not (one.is_bundled or one.is_installed)]
    return sorted(wanted or own or search.packages)


def with_bundled(search: SearchPath, names: list[str]) -> SearchPath:
    """Return a search path in which bundled packages precede installed packages, for the packages in `names` (empty:
    all).

    Without this change a new installation would repeat the old one: installed wheels precede the bundled definitions,
    even after a change of ROS_DISTRO or an update of this package.
    """
    bundled = {one.name: one for one in search.hidden if one.is_bundled and one.name in (names or search.packages)}
    packages = {name: bundled.get(name, one) if one.is_installed else one for name, one in search.packages.items()}
    return replace(search, packages=packages)


def build_wheels(search: SearchPath, wanted: list[str], out: Path, *, dependencies: bool = True) -> list[BuiltWheel]:
    """Write the wheels of packages, and of their dependencies that are not installed as wheels, into a folder.

    Args:
        search: search path of the packages.
        wanted: names of packages; empty for the packages of the user's folders, or for all without such packages.
        out: folder for the wheels.
        dependencies: also make wheels of dependencies.

    Raises:
        DefinitionError: a package is not on the search path, or a definition or manifest has problems.
        OSError: the folder cannot be written.
    """
    packages = _selected(search, wanted)
    if not wanted and len(packages) == len(search.packages):
        search = with_bundled(search, packages)
    files, uses = _generated(search, packages)
    chosen = [name for name in files if name in packages or (dependencies and not search.packages[name].is_installed)]
    out.mkdir(parents=True, exist_ok=True)
    return [_build(search, search.packages[name], files[name], uses[name], out) for name in chosen]


def _generated(search: SearchPath, packages: list[str]) -> tuple[dict[str, dict[str, bytes]], dict[str, set[str]]]:
    """Return the generated files of each package in `packages` and their dependencies, and the packages that its code
    imports.
    """
    wanted = set(packages)
    while True:
        if more := {one for name in wanted for one in _declared(search, name)} - wanted:
            wanted |= more
            continue
        with TemporaryDirectory(prefix="rosidl-py-gen-wheel-") as top:
            try:
                run = generate(search, sorted(wanted), Path(top))
            except DefinitionError as error:
                error.partial = False  # a wheel needs the whole package
                raise
            found = {name.package for name in run.names}
            if found <= wanted:
                return _read(Path(top), found)
        wanted |= found  # whole packages, not only the required interfaces


def _declared(search: SearchPath, name: str) -> set[str]:
    return set(PackageManifest.read(search.packages[name].folder).depends) & search.packages.keys()


def _read(top: Path, packages: set[str]) -> tuple[dict[str, dict[str, bytes]], dict[str, set[str]]]:
    files: dict[str, dict[str, bytes]] = {}
    uses: dict[str, set[str]] = {}
    for package in sorted(packages):
        paths = [path for path in sorted((top / package).rglob("*")) if path.is_file()]
        files[package] = {path.relative_to(top).as_posix(): path.read_bytes() for path in paths}
        texts = (data.decode() for name, data in files[package].items() if name.endswith(".py"))
        imported = {name for text in texts for name in _IMPORT.findall(text)}
        uses[package] = (imported & packages) - {package}
    return files, uses


def _build(search: SearchPath, package: Package, files: dict[str, bytes], uses: set[str], out: Path) -> BuiltWheel:
    """Build the wheel of a package in the folder `out`, replacing an older wheel of the same file name."""
    manifest = PackageManifest.read(package.folder)
    requires = [_compatible_versions(__version__)]
    for used in sorted(uses | _declared(search, package.name)):
        version = PackageManifest.read(search.packages[used].folder).version
        requires.append(f"{used.replace('_', '-')}=={version}")
    contents = {f"{package.name}/{name.kind}/{path.name}": path.read_bytes() for name, path in package.files.items()}
    contents[f"{package.name}/package.xml"] = (package.folder / "package.xml").read_bytes()
    entry_points = {InstalledInterfaces.ENTRY_POINTS: {package.name: package.name}}
    made = manifest.write_wheel(out, package.name, files | contents, entry_points, requires=requires)
    return BuiltWheel(package.name.replace("_", "-"), made, tuple(requires))


def write_wheel(
    out: Path,
    module: str,
    files: Mapping[str, bytes],
    metadata: dict[str, object],
    entry_points: dict[str, dict[str, str]] | None = None,
    data: Mapping[str, bytes] | None = None,
    programs: Collection[str] = (),
) -> Path:
    """Write the wheel of a Python package into the folder `out` and return the path of the wheel.

    Replaces an older wheel of the same file name. The keys of `files` are paths below site-packages, the keys of
    `data` are paths below the environment; `programs` are the keys of executable files.
    """
    from flit_core.common import Metadata, Module
    from flit_core.wheel import WheelBuilder

    with TemporaryDirectory(prefix="rosidl-py-gen-wheel-") as folder:
        top = Path(folder)
        data_folder = top / f"{module}.data"  # no module can have this name
        placed = [(top / name, content) for name, content in files.items()]
        placed += [(data_folder / name, content) for name, content in (data or {}).items()]
        for path, content in placed:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        for name in programs:
            (data_folder / name).chmod(0o755)
        partial = out / f".{module}.whl.part"
        try:
            with partial.open("wb") as file:
                # A pyproject.toml would lose the license of package.xml: flit_core takes only SPDX expressions there.
                builder = WheelBuilder(
                    top,
                    Module(module, top),
                    Metadata(metadata),
                    entry_points or {},
                    file,
                    data_folder if data else None,
                )
                builder.source_time_stamp = builder.source_time_stamp or _EARLIEST
                builder.build()
            return partial.replace(out / builder.wheel_filename)
        finally:
            partial.unlink(missing_ok=True)


def _compatible_versions(version: str) -> str:
    """Return the version requirement on rosidl-py-gen that a generated wheel gets: `version` or later, with the same
    minor version.
    """
    major, minor = version.split(".")[:2]
    return f"rosidl-py-gen>={version},<{major}.{int(minor) + 1}"


@dataclass(frozen=True, slots=True)
class PackageManifest:
    """Contents of a package.xml whose version pip accepts; a maintainer is ``name <address>``, a name or an address."""

    version: str
    description: str
    license: str
    maintainers: tuple[str, ...]
    urls: tuple[tuple[str, str], ...]
    depends: tuple[str, ...]

    @classmethod
    def read(cls, folder: Path) -> PackageManifest:
        """Read the package.xml in a folder.

        Raises `DefinitionError` if it is missing or invalid, or if its version is not valid for pip.
        """
        path = folder / "package.xml"
        if not path.exists():
            raise DefinitionError(
                Diagnostic(str(path), 0, 0, "there is no such file; a wheel needs its name and version")
            )
        root = XmlElement.read(str(path))
        elements = [*root.elements]

        def texts(*tags: str) -> list[str]:
            return [_line(one.text) for tag in tags for one in elements if one.tag == tag]

        version = next(iter(texts("version")), "")
        if not _VERSION.fullmatch(version):
            raise root.error(f'the version is "{version[:80]}"; pip needs one such as 1.2.3')
        return cls(
            version,
            next(iter(texts("description")), ""),
            " AND ".join(texts("license")),
            tuple(_person(one) for one in elements if one.tag == "maintainer"),
            tuple((one.attributes.get("type") or "website", _line(one.text)) for one in elements if one.tag == "url"),
            tuple(texts("depend", "build_depend", "exec_depend", "build_export_depend")),
        )

    def write_wheel(
        self,
        out: Path,
        module: str,
        files: Mapping[str, bytes],
        entry_points: dict[str, dict[str, str]],
        data: Mapping[str, bytes] | None = None,
        programs: Collection[str] = (),
        *,
        requires: Sequence[str] = (),
    ) -> Path:
        """Write the wheel of the package with the metadata of its package.xml, as the function `write_wheel` does.

        `requires` are the requirements of the wheel.
        """
        metadata: dict[str, object] = {
            "name": module.replace("_", "-"),
            "version": self.version,
            "summary": self.description[:500] or None,
            "license": self.license or None,
            "project_urls": [f"{label}, {url}" for label, url in self.urls if url],
            "keywords": "ros2,rosidl",
            "classifiers": ["Typing :: Typed"],
            "requires_python": ">=3.10",
            "requires_dist": [*requires],
        }
        for one in self.maintainers[:1]:
            metadata["maintainer_email" if "<" in one else "maintainer"] = one
        return write_wheel(out, module, files, metadata, entry_points, data, programs)


def _line(text: str) -> str:
    return " ".join(text.split())


def _person(element: XmlElement) -> str:
    name, address = _line(element.text), _line(element.attributes.get("email", ""))
    return f"{name} <{address}>" if name and address else name or address
