"""Command ``bag reindex``: repairs metadata and indexes of a bag."""

from __future__ import annotations

from pathlib import Path
from shlex import quote

import click

from rosidl_py_gen.base.terminal_text import pluralize, print_next_step
from rosidl_py_gen.ros_cli import DAMAGED, options, terminal_output, verb


@click.command("reindex")
@options.bag_path
@options.as_json
@verb
def reindex(path: str, as_json: bool) -> int:
    """Recreate the metadata.yaml of a bag folder, and repair files without an index, as after a crash.

    A repaired file is rewritten; the old file is renamed to FILE.unindexed. Stop the recorder first.

    \b
    rosidl-py bag reindex my_bag
    rosidl-py bag reindex my_bag/my_bag_3.mcap
    """
    from rosidl_py_gen.bags.copying import omission_lines
    from rosidl_py_gen.bags.reindexing import reindex_file, reindex_folder
    from rosidl_py_gen.ros_cli.bag.display import ProgressBar, damaged_rows

    location = Path(path)
    with ProgressBar("bytes") as show:
        result = reindex_folder(location, show) if location.is_dir() else reindex_file(location, show)
    if as_json:
        terminal_output.document(
            {
                "path": str(result.path),
                "files": result.files,
                "messages": result.messages,
                "topics": result.topics,
                "without_index": list(result.unindexed_files),
                "kept": None if len(result.repaired) != 1 else str(result.repaired[0].backup),
                "repaired": [{"file": str(one.path), "kept": str(one.backup)} for one in result.repaired],
                "damaged": damaged_rows(result.damaged),
                "unread_bytes": result.unread_bytes,
                "not_carried_over": dict(result.omitted),
            }
        )
        return DAMAGED if result.damaged else 0
    for one in result.repaired:
        reason = "had no index and is" if one.path.name in result.unindexed_files else "is"
        terminal_output.note(f"{one.path.name} {reason} rewritten; the old file is renamed to {one.backup}")
    for line in omission_lines(result.omitted):
        terminal_output.note(line)
    counts = f"{pluralize(result.messages, 'message')} of {pluralize(result.topics, 'topic')}"
    terminal_output.line(f"{counts} in {pluralize(result.files, 'file')}: {result.path}")
    print_next_step("rosidl-py bag info", quote(str(result.path)))
    return DAMAGED if result.damaged else 0
