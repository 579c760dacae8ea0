"""Command ``ros2`` for programs and launch files where ROS is not installed, which runs ``rosidl-py``.

`prefix.build` writes a program that calls `main` into each prefix. ``run``, ``launch`` and ``test`` append its folder
to the end of PATH, so that a ``ros2`` of ROS takes precedence.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.ros_cli import exit_on_error

_PACKAGES = Path("share", "ament_index", "resource_index", "packages")


def main() -> None:
    """Run the command ``ros2`` with the arguments of this process; most commands are run by ``rosidl-py``."""
    from rosidl_py_gen import ros_cli

    words = sys.argv[1:]
    run = _VERBS.get(words[0]) if words else None
    if run is None:
        ros_cli.main()
        return
    with exit_on_error():
        sys.exit(run(words[1:]))


def _daemon(words: Sequence[str]) -> int:
    """Report success for ``ros2 daemon``, which scripts call to restart discovery, although there is no daemon."""
    verb = words[0] if words else ""
    if verb not in ("start", "status", "stop"):
        raise CommandError(f'ros2 daemon: no verb "{verb}"; expected start, status or stop')
    terminal_output.note("note: rosidl-py has no daemon; each command discovers nodes")
    return 0


def _pkg(words: Sequence[str]) -> int:
    """Run ``ros2 pkg`` with the words executables, list or prefix, and return 0.

    Raises `CommandError` for other words.
    """
    verb, *rest = (*words, "")
    options = {word for word in rest if word.startswith("-")}
    names = [word for word in rest if word and word not in options]
    if verb == "executables" and not options - {"--full-path"}:
        from rosidl_py_gen import ros_cli

        ros_cli.main(["run", "--list", *names])
        return 0
    if verb == "list" and not options and not names:
        terminal_output.lines(sorted(_prefixes()))
        return 0
    if verb == "prefix" and len(names) == 1 and not options - {"--share"}:
        prefix = _prefixes().get(names[0])
        if prefix is None:
            raise CommandError(f'ros2 pkg: no package "{names[0]}" in AMENT_PREFIX_PATH')
        terminal_output.line(os.path.join(prefix, "share", names[0]) if options else prefix)
        return 0
    text = " ".join(("ros2 pkg", *words))
    raise CommandError(f"{text}: expected `executables [PACKAGE]`, `list`, or `prefix [--share] PACKAGE`")


_VERBS: dict[str, Callable[[Sequence[str]], int]] = {"daemon": _daemon, "pkg": _pkg}
"""Functions that run those commands of ros2 that rosidl-py does not have."""


def _prefixes() -> dict[str, str]:
    """Return the prefix of each package in AMENT_PREFIX_PATH by name.

    If several prefixes have a package, the first of them is returned.
    """
    found: dict[str, str] = {}
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        folder = Path(prefix) / _PACKAGES
        for name in os.listdir(folder) if folder.is_dir() else ():
            found.setdefault(name, prefix)
    return found
