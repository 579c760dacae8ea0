"""Command ``rosidl-py prefix``."""

from __future__ import annotations

import click

from rosidl_py_gen.base.terminal_text import pluralize, print_next_step
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.generator_cli import distro
from rosidl_py_gen.ros_cli import options, verb


@click.command("prefix")
@click.argument("sources", nargs=-1, metavar="[SRC]...", type=click.Path())
@click.option(
    *("-o", "--output", "--out", "out"),
    metavar="DIR",
    type=click.Path(file_okay=False),
    default=".ros",
    show_default=True,
    help="Prefix.",
)
@distro
@options.as_json
@verb
def prefix(sources: tuple[str, ...], out: str, as_json: bool) -> int:
    """Create or update an ament prefix of a workspace, without a build.

    SRC is a workspace, a folder of packages, or a package; by default the workspace of the current folder. The prefix
    has links to the sources: new contents need no second call, new files do.

    \b
    rosidl-py prefix ~/ws/src --out ~/ws/.ros
    source ~/ws/.ros/setup.bash
    python -c 'import my_package'
    """
    from pathlib import Path
    from shlex import quote

    from rosidl_py_gen.errors import display_path
    from rosidl_py_gen.prefix import build_prefix

    made = build_prefix(map(Path, sources) if sources else None, Path(out))
    if made.unsafe:
        cure = f"correct it, for example with `chmod -R go-w {quote(out)}`, or choose another folder with --out"
        terminal_output.note(f"warning: {made.unsafe}: another user can run code as each user of this prefix; {cure}")
    if as_json:
        packages = {name: str(folder) for name, folder in made.packages.items()}
        skipped = [{"name": one.name, "executables": one.missing, "text": one.text} for one in made.skipped]
        others = {"folder": str(made.folder), "packages": packages, "skipped": skipped}
        terminal_output.document(vars(made) | others)
    else:
        for text in made.notes:
            terminal_output.note(f"note: {text}")
        for problem in made.problems:
            terminal_output.note(f"warning: {problem}")
        is_changed = made.created or made.removed
        changes = f"{pluralize(made.created, 'file')} written, {made.removed} removed" if is_changed else "up to date"
        terminal_output.line(f"{display_path(made.folder)}: {pluralize(len(made.packages), 'package')}, {changes}")
        if is_changed and made.skipped:
            terminal_output.lines(("C++ code is not built:", *(f"  {one.text}" for one in made.skipped)))
        print_next_step("source", quote(display_path(made.folder / "setup.bash")))
    return int(bool(made.problems))
