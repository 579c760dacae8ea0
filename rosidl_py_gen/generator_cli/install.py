"""The options --install and --uninstall: message packages of this environment."""

from __future__ import annotations

from rosidl_py_gen.compiler.frontend.registry import split_filter
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.generator_cli.diagnostics_output import echo, print_json
from rosidl_py_gen.wheels.environment import install, uninstall


def run(action: str, paths: tuple[str, ...], selection: str, force: bool, as_json: bool) -> int:
    """Run the command and return its exit code."""
    wanted = sorted({name.partition("/")[0] for name in split_filter(selection)})
    if action == "uninstall":
        changed = uninstall(wanted, force=force)
    else:
        search = scan_search_path(paths)
        changed = install(search, wanted or [*search.packages], force=force)
    if as_json:
        print_json({action: changed})
    else:
        echo(f"{action}ed {', '.join(changed) or 'nothing'}")
    return 0
