"""The commands of `rosidl-py-gen` except `diff`: generate, list, install, check, print a definition, make wheels.

Each returns the exit code; problems are raised.
"""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, read_checked, split_filter
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.compiler.generate import generate, load, notes_of
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.generator_cli.diagnostics_output import (
    count,
    echo,
    print_json,
    print_line,
    print_notes,
    print_problems,
    rows,
)

if TYPE_CHECKING:
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath
    from rosidl_py_gen.compiler.generate import GenerationResult

_PROGRESS_DELAY_S = 1.0
"""Time after which a progress bar appears."""


def check(names: tuple[str, ...], paths: tuple[str, ...], as_json: bool) -> int:
    """Read definitions and report their problems."""
    search = scan_search_path(paths)
    _, found = load(search, list(names))
    notes = notes_of(search, found)
    packages = sorted({name.package for name in found})
    if as_json:
        interfaces = [str(name) for name in found]
        print_json({"interfaces": interfaces, "errors": [], "notes": rows(notes)})
    else:
        print_notes(notes)
        echo(f"{len(found)} interfaces in {len(packages)} packages: no problems")
    return 0


def interface(name: str, paths: tuple[str, ...], full: bool, as_json: bool) -> int:
    """Print a definition with its type hash."""
    from rosidl_py_gen.base.descriptions import build_type_description
    from rosidl_py_gen.compiler.frontend.definition_text import full_text, source_text
    from rosidl_py_gen.type_loading.from_description import registry_of_generated_class

    top = split_ros_name(name, "msg")
    registry, generated = InterfaceRegistry(scan_search_path(paths)), None
    try:
        owner = read_checked(registry, top)
    except TypeNotFoundError:
        generated = registry_of_generated_class(name)
        if generated is None:
            raise
        registry, owner, note = generated
        print_line(f"note: {note}")
    if as_json:
        print_json({"hash": registry.type_hash(str(top)), **build_type_description(str(top), registry.field_rows)})
        return 0
    if full:
        echo(full_text(registry, owner).removesuffix("\n"))
        return 0
    echo((f"# {top}  {registry.type_hash(str(top))}", "bold"))
    text = source_text(registry, owner) if generated is None else full_text(registry, owner)
    echo(text.removesuffix("\n"))
    return 0


def wheel(names: tuple[str, ...], paths: tuple[str, ...], out: str, no_dependencies: bool, as_json: bool) -> int:
    """Make wheels of message packages."""
    from rosidl_py_gen.wheels.build import build, selected_packages

    search = scan_search_path(paths)
    built = build(search, selected_packages(search, [*names]), Path(out), dependencies=not no_dependencies)
    if as_json:
        print_json([{"package": one.package, "path": str(one.path), "requires": list(one.requires)} for one in built])
        return 0
    for one in built:
        echo(str(one.path))
    made = {"rosidl-py-gen", *(one.package for one in built)}
    required = {text for one in built for text in one.requires}
    if missing := sorted(text for text in required if re.split("[=>]", text)[0] not in made):
        reason = "" if no_dependencies else ", because they are installed"
        texts = ", ".join(missing)
        echo(f"required, but not made{reason}: {texts}; name packages to make wheels of them", err=True)
    return 0


def install(action: str, paths: tuple[str, ...], selection: str, force: bool, as_json: bool) -> int:
    """Install or uninstall message packages of this environment."""
    from rosidl_py_gen.wheels import environment

    wanted = sorted({name.partition("/")[0] for name in split_filter(selection)})
    if action == "uninstall":
        changed = environment.uninstall(wanted, force=force)
    else:
        search = scan_search_path(paths)
        changed = environment.install(search, wanted or [*search.packages], force=force)
    if as_json:
        print_json({action: changed})
    else:
        echo(f"{action}ed {', '.join(changed) or 'nothing'}")
    return 0


def generate_or_list(
    paths: tuple[str, ...], selection: str, out: str, check: bool, keep_going: bool, listing: bool, as_json: bool
) -> int:
    """Generate packages, or list those of the search path."""
    search = scan_search_path(paths)
    if listing:
        _list(search, split_filter(selection), as_json)
        return 0
    progress = _Progress()
    try:
        wanted = split_filter(selection)
        result = generate(search, wanted, Path(out), dry=check, keep_going=keep_going, progress=progress)
    finally:
        progress.close()
    changed = bool(result.changes.written or result.changes.removed)
    _print(result, out, check, as_json)
    return 1 if result.problems or (check and changed) else 0


class _Progress:
    """A progress bar on the terminal for long runs."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._bar: Any = None
        self._terminal = sys.stderr.isatty()

    def __call__(self, name: RosName, done: int, total: int) -> None:
        if not self._terminal or time.monotonic() - self._start < _PROGRESS_DELAY_S:
            return
        if self._bar is None:
            self._bar = click.progressbar(length=total, label="generating", file=sys.stderr)
            self._bar.__enter__()
            self._bar.update(done)
        self._bar.update(1)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.__exit__(None, None, None)


def _print(result: GenerationResult, out: str, check: bool, as_json: bool) -> None:
    changes = result.changes
    if as_json:
        print_json(
            {
                "out": out,
                "interfaces": [str(name) for name in result.names],
                "written": list(changes.written),
                "removed": list(changes.removed),
                "unchanged": changes.unchanged,
                "errors": rows(result.problems),
                "notes": rows(result.notes),
            }
        )
        return
    print_notes(result.notes)
    print_problems(result.problems)
    if check:
        for name in changes.written:
            echo(f"would write {Path(out) / name}")
        for name in changes.removed:
            echo(f"would remove {Path(out) / name}")
    packages = len({name.package for name in result.names})
    verb = "would be written" if check else "written"
    echo(
        f"{len(result.names)} interfaces in {packages} packages: {len(changes.written)} files {verb}, "
        f"{len(changes.removed)} removed, {changes.unchanged} unchanged"
    )
    if result.problems:
        print_line(f"{count(result.problems)}; interfaces with problems were skipped")


def _list(search: SearchPath, wanted: list[str], as_json: bool) -> None:
    chosen = {text.split("/")[0] for text in wanted} or {*search.packages}
    every = [(package, True) for package in search.packages.values()] + [(package, False) for package in search.hidden]
    rows = [row for row in every if row[0].name in chosen]
    rows.sort(key=lambda row: (row[0].name, not row[1]))
    if as_json:
        print_json(
            [
                {
                    "package": package.name,
                    "folder": str(package.folder),
                    "origin": package.origin,
                    "used": used,
                    "interfaces": [str(name) for name in package.files],
                }
                for package, used in rows
            ]
        )
        return
    width = max((len(package.name) for package, _ in rows), default=0)
    for package, used in rows:
        note = "" if used else "  (hidden by the one above)"
        place = package.origin if package.origin == "bundled" else str(package.folder)
        echo((package.name.ljust(width), "bold" if used else ""), f"  {len(package.files):3}  {place}{note}")
