"""Wheels of message packages: which, and what is in them.

Decides that a wheel has a whole package: the generated code, ``py.typed``, package.xml and the definitions, so that
packages which use it can be made of it. The layout of nested messages is written into the code of those who use them,
so a wheel asks for exactly the versions it was made with. A package that is installed as a wheel already is not made
again.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rosidl_py_gen import __version__
from rosidl_py_gen.base.resources import ENTRY_POINTS
from rosidl_py_gen.compiler.generate import generate
from rosidl_py_gen.compiler.spec.find import INSTALLED
from rosidl_py_gen.distribution.manifest import Manifest, read_manifest
from rosidl_py_gen.distribution.wheel import Wheel
from rosidl_py_gen.errors import DefinitionError, Problem

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.spec.find import Package, SearchPath

_IMPORT = re.compile(r"^\s*(?:from|import) +([A-Za-z_][A-Za-z0-9_]*)[. ]", re.MULTILINE)
_BUNDLED = "bundled"


@dataclass(frozen=True, slots=True)
class Built:
    """A wheel on disk."""

    package: str
    path: Path
    requires: tuple[str, ...]


def packages_asked_for(search: SearchPath, wanted: list[str]) -> list[str]:
    """Names of the packages a user means: all of the given folders when none is named.

    Raises:
        DefinitionError: no such package, or nothing but bundled ones where nothing is named.
    """
    for name in wanted:
        if name not in search.packages:
            known = ", ".join(search.packages)[:300]
            raise DefinitionError(Problem(name, 0, 0, f"there is no package of this name; there are {known}"))
    found = wanted or [name for name, one in search.packages.items() if one.origin not in (_BUNDLED, INSTALLED)]
    if not found:
        raise DefinitionError(
            Problem("wheel", 0, 0, "name packages, such as std_msgs, or give the folder of your own with --path")
        )
    return sorted(found)


def wheels_of(search: SearchPath, packages: list[str], *, dependencies: bool = True) -> list[Wheel]:
    """The wheels of packages, and of those they use that are not installed as wheels.

    Raises:
        DefinitionError: problems in definitions or manifests. OutputError: the temporary folder cannot be written.
    """
    files, uses = _generated(search, packages)
    chosen = [name for name in files if name in packages or (dependencies and _origin(search, name) != INSTALLED)]
    return [_wheel(search, search.packages[name], files[name], uses[name]) for name in chosen]


def build(search: SearchPath, packages: list[str], out: Path, *, dependencies: bool = True) -> list[Built]:
    """Write the wheels of `wheels_of` into a folder; errors as there, and OSError."""
    found = []
    for wheel in wheels_of(search, packages, dependencies=dependencies):
        requires = tuple(value for key, value in wheel.metadata if key == "Requires-Dist")
        found.append(Built(wheel.name, wheel.write(out), requires))
    return found


def _origin(search: SearchPath, name: str) -> str:
    return search.packages[name].origin


def _generated(search: SearchPath, packages: list[str]) -> tuple[dict[str, dict[str, bytes]], dict[str, set[str]]]:
    """Generated files of each package of these and of all they use, and which others each imports."""
    wanted = set(packages)
    while True:
        if more := {one for name in wanted for one in _declared(search, name)} - wanted:
            wanted |= more
            continue
        with TemporaryDirectory(prefix="rosidl-py-gen-wheel-") as top:
            try:
                run = generate(search, sorted(wanted), Path(top))
            except DefinitionError as error:
                error.partial = False  # a wheel is whole or not made
                raise
            found = {name.package for name in run.names}
            if found <= wanted:
                return _read(Path(top), found)
        wanted |= found  # whole packages, not only what is used of them


def _declared(search: SearchPath, name: str) -> set[str]:
    """Interface packages that a package says it depends on."""
    return set(read_manifest(search.packages[name].folder, name).depends) & search.packages.keys()


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


def _wheel(search: SearchPath, package: Package, files: dict[str, bytes], uses: set[str]) -> Wheel:
    manifest = read_manifest(package.folder, package.name)
    files = dict(files)
    files[f"{package.name}/package.xml"] = (package.folder / "package.xml").read_bytes()
    for name, path in package.files.items():
        files[f"{package.name}/{name.kind}/{path.name}"] = path.read_bytes()
    requires = [_compatible(__version__)]
    for used in sorted(uses | _declared(search, package.name)):
        version = read_manifest(search.packages[used].folder, used).version
        requires.append(f"{used.replace('_', '-')}=={version}")
    return Wheel(
        package.name.replace("_", "-"),
        manifest.version,
        _metadata(manifest, requires),
        files,
        f"[{ENTRY_POINTS}]\n{package.name} = {package.name}\n",
    )


def _compatible(version: str) -> str:
    """Versions of this package that run what this one generated: those of the same minor number."""
    major, minor = version.split(".")[:2]
    return f"rosidl-py-gen>={version},<{major}.{int(minor) + 1}"


def _metadata(manifest: Manifest, requires: list[str]) -> tuple[tuple[str, str], ...]:
    found = [("Summary", manifest.description[:500])] if manifest.description else []
    found += [("Maintainer-email" if "<" in one else "Maintainer", one) for one in manifest.maintainers[:1]]
    found += [("License", manifest.license)] if manifest.license else []
    found += [("Project-URL", f"{label}, {url}") for label, url in manifest.urls if url]
    found += [("Keywords", "ros2,rosidl"), ("Classifier", "Typing :: Typed"), ("Requires-Python", ">=3.10")]
    return (*found, *(("Requires-Dist", one) for one in requires))
