"""Command group ``rosidl-py bag``; its verbs are imported when called."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

bag = LazyGroup(
    "bag",
    package=__name__,
    help="Recordings: record, play, info, convert, migrate, reindex; as tables: table, sql; as a plot: plot.\n\n"
    "Bags are MCAP files, and rosbag2 folders of MCAP or SQLite files.",
    verbs={
        "convert": ("convert", "Copy a bag: SQLite as MCAP or the reverse, a selection."),
        "info": ("info", "Print the contents of a bag."),
        "migrate": ("migrate", "Convert a recording to changed definitions: fields are matched by name."),
        "play": (".playback.command", "Publish the messages of a bag with the recorded timing."),
        "plot": ("plot", "Plot fields of topics over time."),
        "record": (".recording.command", "Record topics until Ctrl-C or SIGTERM."),
        "reindex": ("reindex", "Recreate the metadata.yaml of a bag folder, as after a crash."),
        "sql": ("sql", "Query bags, or a dataset of `bag table`, with the SQL of DuckDB."),
        "table": ("table", "Write bags as a Parquet dataset, for polars, pandas, DuckDB and Spark."),
    },
)
