"""``rosidl-py bag``: a module for each command, or for several that do nearly the same."""

import click

from rosidl_py_gen.ros_cli.groups import LazyGroup


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs={
        "convert": (
            "convert",
            "Write a bag again: SQLite as MCAP or the reverse, a part of it.",
        ),
        "info": ("info", "Print what a bag holds."),
        "migrate": ("migrate", "Carry a recording over to changed definitions, field by field, by their names."),
        "play": (".playback.command", "Publish what a bag holds, as far apart as it was recorded."),
        "record": (".recording.command", "Record topics until Ctrl-C or SIGTERM."),
        "reindex": ("reindex", "Write the metadata.yaml of a bag folder again, as after a crash."),
        "sql": ("sql", "Ask bags, or a dataset that `bag table` has written, with the SQL of DuckDB."),
        "table": ("table", "Write bags as a Parquet dataset, for polars, pandas, DuckDB and Spark."),
    },
)
def bag() -> None:
    """Recordings: record, play, info, convert, migrate, reindex; as tables: table, sql.

    Bags are MCAP files, and rosbag2 folders of MCAP or SQLite files.
    """
