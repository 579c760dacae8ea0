"""``bag reindex``."""

from __future__ import annotations

from pathlib import Path

import click

from rosidl_py_gen.ros_cli import DAMAGED, options, terminal_output, verb


@click.command("reindex")
@options.bag_path
@options.as_json
@verb
def reindex(path: str, as_json: bool) -> int:
    """Write the metadata.yaml of a bag folder again, as after a crash; give a single MCAP file its index.

    A file that gets an index is written again; what it was before is kept beside it, as FILE.unindexed.

    \b
    rosidl-py bag reindex my_bag
    rosidl-py bag reindex my_bag/my_bag_3.mcap
    """
    from rosidl_py_gen.bags.reindexing import reindex_file, reindex_folder
    from rosidl_py_gen.ros_cli.bag.selection import damaged_rows

    place = Path(path)
    done = reindex_folder(place) if place.is_dir() else reindex_file(place)
    if as_json:
        terminal_output.document(
            {
                "path": str(done.path),
                "files": done.files,
                "messages": done.messages,
                "topics": done.topics,
                "without_index": list(done.unindexed_files),
                "kept": None if done.backup is None else str(done.backup),
                "damaged": damaged_rows(done.damaged),
            }
        )
        return DAMAGED if done.damaged else 0
    for name in done.unindexed_files:
        terminal_output.note(
            f"{name} has no index: it is read once through when it is opened; `rosidl-py bag reindex` gives it one"
        )
    if done.backup is not None:
        terminal_output.note(f"what it was before is kept as {done.backup}")
    terminal_output.line(f"{done.messages} messages of {done.topics} topics in {done.files} files: {done.path}")
    return DAMAGED if done.damaged else 0
