"""Run of the compiler, from a search path and a selection of interfaces to files in a folder.

Each type has one class: if `rosidl_py_gen.msgs` has the class of a type, it is not generated again.

Only changed files are written, each through a temporary file, so an interrupted run leaves complete files. Generated
files are removed if their definition no longer exists. Files without the header of generated files are never changed.
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from itertools import count
from pathlib import Path
from typing import NamedTuple

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.names import RosName, py_name
from rosidl_py_gen.base.resources import DataFolders, GeneratedCode
from rosidl_py_gen.compiler.codegen.module_sources import Target, module_path, package_sources
from rosidl_py_gen.compiler.frontend.bundled import BundledInterfaces
from rosidl_py_gen.compiler.frontend.partial_selection import drop_unused_invalid_files, split_valid
from rosidl_py_gen.compiler.frontend.registry import (
    InterfaceRegistry,
    check,
    select,
    select_valid_names,
    sorted_diagnostics,
)
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.errors import DefinitionError, Diagnostic, OutputError, display_path


@dataclass(frozen=True, slots=True)
class Changes:
    """File changes of a generator run, as sorted paths relative to the output folder."""

    written: tuple[str, ...]
    removed: tuple[str, ...]
    unchanged: int


def plan_changes(folder: Path, files: dict[str, str], removed: list[str]) -> Changes:
    """Return which of the generated `files` (path -> text) differ from the output folder, which may be missing.

    Args:
        removed: generated files to remove.

    Raises:
        OutputError: the folder has files at these paths that the generator did not write.
    """
    written: list[str] = []
    foreign: list[str] = []
    for name, text in files.items():
        target = folder / name
        parents = [*reversed(Path(name).parents)]  # of "a/b/c": ".", "a", "a/b"
        blockers = (path for path in map(folder.joinpath, parents) if os.path.lexists(path) and not path.is_dir())
        blocker = next(blockers, None)
        if blocker is not None:
            foreign.append(f"{blocker} is a file; expected a folder")
        elif not os.path.lexists(target):
            written.append(name)
        elif not os.path.isfile(target) or not GeneratedCode.is_generated(target):
            foreign.append(f"{target} exists and was not written by rosidl-py-gen")
        elif target.read_bytes() != text.encode():
            written.append(name)
    if foreign:
        raise OutputError(
            "\n".join([*dict.fromkeys(foreign), "Choose another folder with --out, or move these files away."])
        )
    return Changes(tuple(written), tuple(removed), len(files) - len(written))


def apply_changes(folder: Path, files: dict[str, str], changes: Changes) -> None:
    """Write and remove the files that `plan_changes` returned; raises `OutputError` if a file cannot be written."""
    try:
        for name in changes.written:
            _write(folder / name, files[name])
        for name in changes.removed:
            path = folder / name
            path.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # not empty
                path.parent.rmdir()
    except OSError as error:
        raise OutputError(f"cannot write {error.filename or folder}: {error.strerror or error}") from error


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=".rosidl-", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(text.encode())
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


def generated_files_below(folder: Path, packages: Iterable[str]) -> list[str]:
    """Return the relative paths of generated files in the packages of a folder.

    The files of a package folder follow after the files of its subfolders.

    Raises:
        OutputError: a folder or file cannot be read.
    """
    found: list[str] = []
    try:
        for package in packages:
            for place in (f"{package}/msg", f"{package}/srv", f"{package}/action", package):
                if os.path.isdir(folder / place):
                    names = (name for name in sorted(os.listdir(folder / place)) if name.endswith((".py", "py.typed")))
                    found += [f"{place}/{name}" for name in names if GeneratedCode.is_generated(folder / place / name)]
    except OSError as error:
        raise OutputError(f"cannot read {error.filename or folder}: {error.strerror or error}") from error
    return found


def generated_packages(folder: Path) -> list[str]:
    """Return the names of the packages in an output folder whose ``__init__.py`` the generator wrote."""
    if not os.path.isdir(folder):
        return []
    return [name for name in sorted(os.listdir(folder)) if GeneratedCode.is_generated(folder / name / "__init__.py")]


RUNTIME_PACKAGES = (
    "action_msgs",
    "builtin_interfaces",
    "lifecycle_msgs",
    "rcl_interfaces",
    "rmw_dds_common",
    "rosgraph_msgs",
    "service_msgs",
    "type_description_interfaces",
    "unique_identifier_msgs",
)
"""Packages that the runtime needs; their classes are committed in rosidl_py_gen/msgs."""
_RESERVED = frozenset({"numpy", "rosidl_py_gen", "cyclonedds", "lark", "jinja2", "click"})


@dataclass(frozen=True, slots=True)
class GenerationResult:
    """Result of a generator run: `problems` of skipped interfaces, `notes` on assumptions about CMakeLists.txt."""

    names: tuple[RosName, ...]
    changes: Changes
    problems: tuple[Diagnostic, ...] = ()
    notes: tuple[Diagnostic, ...] = ()


class LoadedInterfaces(NamedTuple):
    """Checked definitions of interfaces, and the names of the wanted interfaces."""

    registry: InterfaceRegistry
    names: list[RosName]

    @classmethod
    def load(cls, search: SearchPath, wanted: list[str]) -> LoadedInterfaces:
        """Return the definitions of the wanted packages and interfaces; an empty list means all.

        Raises:
            DefinitionError: definitions have problems; the error lists all of them.
        """
        registry, names = _read(search, wanted)
        if registry.diagnostics.items:
            raise DefinitionError(sorted_diagnostics(registry.diagnostics.items), search.notes(names))
        return cls(registry, names)

    @classmethod
    def of_distribution(cls, distro: str) -> LoadedInterfaces:
        """Return the bundled definitions of a distribution, and the names of the distribution's interfaces.

        Raises:
            UnknownDistributionError: the definitions of `distro` are not bundled.
        """
        distro = Distribution.selected(distro).name
        bundled = BundledInterfaces.of(distro)
        registry, names = cls.load(SearchPath.scan(ament="", distro=distro), [*bundled.packages])
        return cls(registry, [name for name in names if not bundled.is_absent(name)])


def _read(
    search: SearchPath, wanted: list[str], existing: Iterable[RosName] = ()
) -> tuple[InterfaceRegistry, list[RosName]]:
    """Return the registry and names of the wanted interfaces, and of interfaces that were generated before, parsed and
    checked.

    `existing` has the names of the interfaces that were generated before. The registry contains the diagnostics.
    """
    registry = InterfaceRegistry(search)
    names, problems = select_valid_names(registry, wanted)
    registry.diagnostics.items += problems
    more = [str(name) for name in existing if name not in names and search.file(name)]
    if more:
        names = sorted({*names, *select(registry, more)})
    check(registry, names)
    names = drop_unused_invalid_files(registry, names, wanted)
    _check_modules(registry, names)
    return registry, names


def _check_modules(registry: InterfaceRegistry, names: list[RosName]) -> None:
    """Add diagnostics for package names that Python cannot import or needs itself, and for two interfaces with the same
    module.
    """
    files: dict[str, RosName] = {}
    for name in names:
        file = registry.search.file(name)
        path = display_path(file) if file else str(name)
        if (
            name.package in sys.stdlib_module_names
            or name.package in _RESERVED
            or py_name(name.package) != name.package
        ):
            text = f'a package called "{name.package}" cannot be generated: Python needs that name itself'
            registry.diagnostics.items.append(Diagnostic(path, 0, 0, text))
        first = files.setdefault(module_path(str(name)), name)
        if first != name:
            text = f"{name} and {first} would both be the module {module_path(str(name))}"
            registry.diagnostics.items.append(Diagnostic(path, 0, 0, text))


def generate(
    search: SearchPath,
    wanted: list[str],
    folder: Path,
    *,
    dry: bool = False,
    keep_going: bool = False,
    root: str = "",
    progress: Callable[[RosName, int, int], object] = lambda name, done, total: None,
) -> GenerationResult:
    """Generate packages into a folder.

    Args:
        wanted: names of packages and interfaces; empty for all.
        dry: only determine the changes.
        keep_going: generate the valid interfaces if others have problems.
        root: import prefix if the folder is itself a package; ends with a dot.
        progress: called before each interface with its name, its index and the number of interfaces.

    Raises:
        DefinitionError: definitions have problems, with `keep_going` all of them; no file was written.
        OutputError: the folder has files of another origin, or cannot be written.
    """
    registry, every = _read(search, wanted, _already_generated(search, folder))
    names, skipped = split_valid(registry, every)
    notes = search.notes(every)
    problems = sorted_diagnostics([*registry.diagnostics.items, *(skipped if keep_going else ())])
    if problems and not (keep_going and names):
        raise DefinitionError(problems, notes, partial=bool(names))
    known = runtime_classes(registry) if root != GeneratedCode.RUNTIME_PREFIX else lambda name: None
    index = count()
    target = Target(root, known, registry.type_hash)
    files = package_sources(registry, names, target, lambda name: progress(name, next(index), len(names)))
    # A requested package keeps no generated file without a definition.
    requested = generated_packages(folder) if not wanted else [text for text in wanted if text in search.packages]
    packages = sorted({*requested, *(name.package for name in names)})
    removed = [path for path in generated_files_below(folder, packages) if path not in files]
    changes = plan_changes(folder, files, removed)
    if not dry:
        apply_changes(folder, files, changes)
    return GenerationResult(tuple(names), changes, tuple(problems), tuple(notes))


def _already_generated(search: SearchPath, folder: Path) -> list[RosName]:
    """Return the names of interfaces whose modules are in the output folder already; every run generates them again."""
    if not folder.is_dir():
        return []
    present = set(generated_files_below(folder, list(search.packages)))
    return [
        name
        for package in search.packages.values()
        for name in package.files
        if f"{name.package}/{name.kind}/{name.module_name}.py" in present
    ]


def runtime_classes(registry: InterfaceRegistry) -> Callable[[str], str | None]:
    """Return a lookup function for classes in `rosidl_py_gen.msgs`.

    The function takes the full name of a type and returns the module whose class has the same definition, else None.
    """
    bundled = InterfaceRegistry(SearchPath.scan([DataFolders.interfaces()], ament="", bundled=False))

    @cache
    def find_module(full_name: str) -> str | None:
        name = RosName(*full_name.split("/"))
        if name.package not in RUNTIME_PACKAGES:
            return None
        if registry.interface(name) is None or bundled.interface(name) is None:
            return None
        is_same = registry.description_and_constants(full_name) == bundled.description_and_constants(full_name)
        return GeneratedCode.RUNTIME_PREFIX + module_path(full_name) if is_same else None

    return find_module


def regenerate_msgs(folder: Path, dry: bool = False) -> Changes:
    """Generate the committed `rosidl_py_gen/msgs` from the bundled interfaces, and a table of their hashes."""
    search = SearchPath.scan([DataFolders.interfaces()], ament="", bundled=False)
    result = generate(search, list(RUNTIME_PACKAGES), folder, dry=dry, root=GeneratedCode.RUNTIME_PREFIX)
    table = {
        "hashes.py": _hash_table(*LoadedInterfaces.load(search, list(RUNTIME_PACKAGES))),
        "distribution_hashes.py": _distribution_table(),
    }
    changes = plan_changes(folder, table, [])
    if not dry:
        apply_changes(folder, table, changes)
    return Changes((*result.changes.written, *changes.written), result.changes.removed, result.changes.unchanged)


def generate_pregenerated(folder: Path) -> GenerationResult:
    """Generate the bundled interfaces for a wheel below `GeneratedCode.BUNDLED_PREFIX`."""
    search = SearchPath.scan([DataFolders.interfaces()], ament="", bundled=False)
    result = generate(search, [], folder, root=GeneratedCode.BUNDLED_PREFIX)
    (folder / "__init__.py").write_text(
        f'{GeneratedCode.HEADER}. Do not edit.\n"""The bundled interfaces."""\n', encoding="utf-8"
    )
    return result


def _distribution_table() -> str:
    """Return the source of a module with the hashes of types that differ between distributions."""
    hashes: dict[str, dict[str, list[str]]] = {}
    for distro in Distribution.BUNDLED:
        registry, names = LoadedInterfaces.of_distribution(distro)
        for top in names:
            for name in registry.closure(str(top)):
                if name == str(top) or name.startswith(f"{top}_"):
                    hashes.setdefault(name, {}).setdefault(registry.type_hash(name), []).append(distro)
    rows = ""
    for name, found in sorted(hashes.items()):
        if [*found.values()] != [[*Distribution.BUNDLED]]:
            texts = "".join(f'        "{text}": "{" ".join(distros)}",\n' for text, distros in found.items())
            rows += f'    "{name}": {{\n{texts}    }},\n'
    text = "RIHS01 hashes and their distributions, oldest first, of the bundled types that not all distributions share."
    return _hashes_module(text, rows)


def _hash_table(registry: InterfaceRegistry, names: list[RosName]) -> str:
    hashes = {name: text for top in names for name, text in registry.all_hashes(str(top)).items()}
    rows = "".join(f'    "{name}": "{hashes[name]}",\n' for name in sorted(hashes))
    text = "RIHS01 hashes by type name, for use without the import of the class, which takes longer."
    return _hashes_module(text, rows)


def _hashes_module(description: str, rows: str) -> str:
    return f'{GeneratedCode.HEADER}. Do not edit.\n"""{description}"""\n\nHASHES = {{\n{rows}}}\n'
