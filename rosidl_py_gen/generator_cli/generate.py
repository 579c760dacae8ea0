"""The main job: generate packages, or list what could be generated."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.compiler.frontend.registry import split_filter
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.compiler.generate import generate
from rosidl_py_gen.generator_cli import diagnostics_output

if TYPE_CHECKING:
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath
    from rosidl_py_gen.compiler.generate import GenerationResult

_SILENT_S = 1.0  # a progress bar appears when a run takes longer than this


def run(
    paths: tuple[str, ...], selection: str, out: str, check: bool, keep_going: bool, listing: bool, as_json: bool
) -> int:
    """Returns the exit code."""
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
    """A bar on the terminal once a run has taken a second; silent otherwise."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._bar: Any = None
        self._terminal = sys.stderr.isatty()

    def __call__(self, name: RosName, done: int, total: int) -> None:
        if not self._terminal or time.monotonic() - self._start < _SILENT_S:
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
        diagnostics_output.print_json(
            {
                "out": out,
                "interfaces": [str(name) for name in result.names],
                "written": list(changes.written),
                "removed": list(changes.removed),
                "unchanged": changes.unchanged,
                "errors": diagnostics_output.rows(result.problems),
                "notes": diagnostics_output.rows(result.notes),
            }
        )
        return
    diagnostics_output.print_notes(result.notes)
    diagnostics_output.print_problems(result.problems)
    if check:
        for name in changes.written:
            diagnostics_output.echo(f"would write {Path(out) / name}")
        for name in changes.removed:
            diagnostics_output.echo(f"would remove {Path(out) / name}")
    packages = len({name.package for name in result.names})
    verb = "would be written" if check else "written"
    diagnostics_output.echo(
        f"{len(result.names)} interfaces in {packages} packages: {len(changes.written)} files {verb}, "
        f"{len(changes.removed)} removed, {changes.unchanged} unchanged"
    )
    if result.problems:
        diagnostics_output.print_line(f"{diagnostics_output.count(result.problems)}; what has them was left out")


def _list(search: SearchPath, wanted: list[str], as_json: bool) -> None:
    chosen = {text.split("/")[0] for text in wanted} or {*search.packages}
    every = [(package, True) for package in search.packages.values()] + [(package, False) for package in search.hidden]
    rows = [row for row in every if row[0].name in chosen]
    rows.sort(key=lambda row: (row[0].name, not row[1]))
    if as_json:
        diagnostics_output.print_json(
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
        diagnostics_output.echo(
            (package.name.ljust(width), "bold" if used else ""), f"  {len(package.files):3}  {place}{note}"
        )
