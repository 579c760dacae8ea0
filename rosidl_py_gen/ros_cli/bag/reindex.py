"""``bag reindex``: repair of metadata and indexes."""

from __future__ import annotations

from pathlib import Path

import click

from rosidl_py_gen.ros_cli import DAMAGED, options, terminal_output, verb


@click.command("reindex")
@options.bag_path
@options.as_json
@verb
def reindex(path: str, as_json: bool) -> int:
    """Recreate the metadata.yaml of a bag folder, as after a crash; add an index to a single MCAP file.

    A file that gets an index is rewritten; the old file is renamed to FILE.unindexed.

    \b
    rosidl-py bag reindex my_bag
    rosidl-py bag reindex my_bag/my_bag_3.mcap
    """
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
                "kept": None if result.backup is None else str(result.backup),
                "damaged": damaged_rows(result.damaged),
            }
        )
        return DAMAGED if result.damaged else 0
    for name in result.unindexed_files:
        terminal_output.note(
            f"{name} has no index, so that it is read completely when opened; `rosidl-py bag reindex` adds an index"
        )
    if result.backup is not None:
        terminal_output.note(f"the old file is renamed to {result.backup}")
    terminal_output.line(f"{result.messages} messages of {result.topics} topics in {result.files} files: {result.path}")
    return DAMAGED if result.damaged else 0
