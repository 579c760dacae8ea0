"""One run of the compiler: search path and selection in, files in a folder out.

Ties `spec` and `codegen` together for the command line, for `msgs/` and for tests. Decides which classes are not
printed again because the package already has them (one class per type).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from rosidl_py_gen.base.generated_files import GENERATED_HEADER
from rosidl_py_gen.base.installed_classes import PREGENERATED_PACKAGE
from rosidl_py_gen.base.names import RosName, py_name
from rosidl_py_gen.base.resources import interfaces_dir
from rosidl_py_gen.compiler.codegen.module_sources import package_sources
from rosidl_py_gen.compiler.codegen.output_folder import (
    Changes,
    apply_changes,
    generated_files_below,
    generated_packages,
    plan_changes,
)
from rosidl_py_gen.compiler.codegen.template_model import Target, module_name, module_path
from rosidl_py_gen.compiler.frontend.model import Interface, MessageDef, messages_of
from rosidl_py_gen.compiler.frontend.partial_selection import skip_strays, split_valid
from rosidl_py_gen.compiler.frontend.registry import (
    InterfaceRegistry,
    check,
    select,
    select_valid_names,
    sorted_diagnostics,
)
from rosidl_py_gen.compiler.frontend.search_path import SearchPath, scan_search_path
from rosidl_py_gen.errors import DefinitionError, Diagnostic, display_path

# The packages the runtime itself needs; their classes are committed in rosidl_py_gen/msgs.
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
_MSGS = "rosidl_py_gen.msgs."
_RESERVED = frozenset({"numpy", "rosidl_py_gen", "cyclonedds", "lark", "jinja2", "click"})


@dataclass(frozen=True, slots=True)
class GenerationResult:
    """The outcome: what was generated, and which files changed or would change.

    Attributes:
        names: the interfaces generated.
        changes: to files in the folder.
        problems: what was left out and why; only with `keep_going`.
        notes: what was assumed where a CMakeLists.txt does not tell.
    """

    names: tuple[RosName, ...]
    changes: Changes
    problems: tuple[Diagnostic, ...] = ()
    notes: tuple[Diagnostic, ...] = ()


def load(
    search: SearchPath, wanted: list[str], skip_invalid: Iterable[RosName] = ()
) -> tuple[InterfaceRegistry, list[RosName]]:
    """Parse and check a selection.

    Args:
        search: where definitions are.
        wanted: package and interface names, empty for everything.
        skip_invalid: more interfaces to include if they are valid.

    Raises:
        DefinitionError: every problem found, over all files.
    """
    registry, names = _read(search, wanted, skip_invalid)
    if registry.diagnostics.items:
        raise DefinitionError(sorted_diagnostics(registry.diagnostics.items), notes_of(search, names))
    return registry, names


def _read(search: SearchPath, wanted: list[str], keep: Iterable[RosName]) -> tuple[InterfaceRegistry, list[RosName]]:
    """A selection, read and checked; the registry's diagnostics say what is wrong."""
    registry = InterfaceRegistry(search)
    names, problems = select_valid_names(registry, wanted)
    registry.diagnostics.items += problems
    more = [str(name) for name in keep if name not in names and search.file(name)]
    if more:
        names = sorted({*names, *select(registry, more)})
    check(registry, names)
    names = skip_strays(registry, names, wanted)
    _check_modules(registry, names)
    return registry, names


def notes_of(search: SearchPath, names: Iterable[RosName]) -> list[Diagnostic]:
    """What was assumed about the packages of the names."""
    listings = (search.packages[package].listing for package in sorted({name.package for name in names}))
    return [note for listing in listings if listing for note in listing.notes]


def _check_modules(registry: InterfaceRegistry, names: list[RosName]) -> None:
    """Refuse what Python cannot import: names that hide modules, and two interfaces in one file."""
    files: dict[str, RosName] = {}
    for name in names:
        file = registry.search.file(name)
        shown = display_path(file) if file else str(name)
        if (
            name.package in sys.stdlib_module_names
            or name.package in _RESERVED
            or py_name(name.package) != name.package
        ):
            text = f'a package called "{name.package}" cannot be generated: Python needs that name itself'
            registry.diagnostics.items.append(Diagnostic(shown, 0, 0, text))
        first = files.setdefault(module_path(str(name)), name)
        if first != name:
            text = f"{name} and {first} would both be the module {module_path(str(name))}"
            registry.diagnostics.items.append(Diagnostic(shown, 0, 0, text))


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
        search: where definitions are.
        wanted: package and interface names, empty for everything found.
        folder: receives the packages.
        dry: find out what would change, and change nothing.
        keep_going: generate what is right when other interfaces are wrong; `GenerationResult.problems` says what is
            missing.
        root: import prefix when the folder is itself a package; ends in a dot.
        progress: called before each interface with its name, its number and how many there are.

    Raises:
        DefinitionError: problems in definitions; nothing is written then. With `keep_going`: nothing is right.
        OutputError: files of others are in the way, or writing failed.
    """
    already = _already_generated(search, wanted, folder)
    registry, every = _read(search, wanted, already)
    names, left_out = split_valid(registry, every)
    notes = notes_of(search, every)
    problems = sorted_diagnostics([*registry.diagnostics.items, *(left_out if keep_going else ())])
    if problems and not (keep_going and names):
        raise DefinitionError(problems, notes, partial=bool(names))
    known = runtime_classes(registry) if root != _MSGS else lambda name: None
    done = iter(range(len(names)))
    files = package_sources(
        registry,
        names,
        Target(root, known, registry.type_hash),
        lambda name: progress(name, next(done), len(names)),
    )
    # Whoever asks for a package, or for everything, wants nothing of it left that no definition stands for.
    asked = generated_packages(folder) if not wanted else [text for text in wanted if text in search.packages]
    packages = sorted({*asked, *(name.package for name in names)})
    vanished = [path for path in generated_files_below(folder, packages) if path not in files]
    changes = plan_changes(folder, files, vanished)
    if not dry:
        apply_changes(folder, files, changes)
    return GenerationResult(tuple(names), changes, tuple(problems), tuple(notes))


def _already_generated(search: SearchPath, wanted: list[str], folder: Path) -> list[RosName]:
    """Interfaces whose modules an earlier run put into packages of the folder.

    They are kept up to date with the rest, so that asking for one interface never shrinks what is there.
    """
    if not folder.is_dir():
        return []
    present = set(generated_files_below(folder, list(search.packages)))
    return [
        name
        for package in search.packages.values()
        for name in package.files
        if f"{name.package}/{name.kind}/{module_name(name.name)}.py" in present
    ]


def runtime_classes(registry: InterfaceRegistry) -> Callable[[str], str | None]:
    """Which interfaces have a class in `rosidl_py_gen.msgs` that says exactly the same.

    Same RIHS01 hash, and the same constants and default values, which the hash does not cover.
    """
    bundled = InterfaceRegistry(scan_search_path([interfaces_dir()], ament="", bundled=False))
    answers: dict[str, str | None] = {}

    def known(full_name: str) -> str | None:
        if full_name not in answers:
            answers[full_name] = _own_module(full_name)
        return answers[full_name]

    def _own_module(full_name: str) -> str | None:
        package, kind, name = full_name.split("/")
        interface_name = RosName(package, kind, name)
        if package not in RUNTIME_PACKAGES:
            return None
        theirs, ours = registry.interface(interface_name), bundled.interface(interface_name)
        if theirs is None or ours is None or registry.type_hash(full_name) != bundled.type_hash(full_name):
            return None
        return _MSGS + module_path(full_name) if _facts(theirs) == _facts(ours) else None

    return known


def _facts(interface: Interface) -> list[object]:
    def one(message: MessageDef) -> object:
        fields = [(item.name, item.default) for item in message.fields]
        return fields, sorted((item.name, str(item.value), type(item.value).__name__) for item in message.constants)

    return [one(message) for message in messages_of(interface)]


def regenerate_msgs(folder: Path, dry: bool = False) -> Changes:
    """Generate the committed `rosidl_py_gen/msgs` from the bundled interfaces, and a table of their hashes."""
    search = scan_search_path([interfaces_dir()], ament="", bundled=False)
    run = generate(search, list(RUNTIME_PACKAGES), folder, dry=dry, root=_MSGS)
    table = {"hashes.py": _hash_table(*load(search, list(RUNTIME_PACKAGES)))}
    changes = plan_changes(folder, table, [])
    if not dry:
        apply_changes(folder, table, changes)
    return Changes((*run.changes.written, *changes.written), run.changes.removed, run.changes.unchanged)


def generate_pregenerated(folder: Path) -> GenerationResult:
    """Generate all bundled interfaces for a wheel, where they are the package `PREGENERATED_PACKAGE`."""
    search = scan_search_path([interfaces_dir()], ament="", bundled=False)
    run = generate(search, [], folder, root=PREGENERATED_PACKAGE)
    (folder / "__init__.py").write_text(
        f'{GENERATED_HEADER}. Do not edit.\n"""The bundled interfaces."""\n', encoding="utf-8"
    )
    return run


def _hash_table(registry: InterfaceRegistry, names: list[RosName]) -> str:
    """The module `rosidl_py_gen.msgs.hashes`."""
    hashes = {name: text for top in names for name, text in registry.all_hashes(str(top)).items()}
    rows = "".join(f'    "{name}": "{hashes[name]}",\n' for name in sorted(hashes))
    return f"""{GENERATED_HEADER}. Do not edit.
\"\"\"RIHS01 hashes by type name, for use without the import of the class, which takes longer.\"\"\"

HASHES = {{
{rows}}}
"""
