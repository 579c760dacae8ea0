"""``rosidl-py bag``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from rosidl_py_gen.base.resources import require
from rosidl_py_gen.tools import options, run_command
from rosidl_py_gen.tools.commands.bag_play import play
from rosidl_py_gen.tools.commands.bag_record import record

F = TypeVar("F", bound=Callable[..., Any])

_path = click.argument("path", type=click.Path())
_compression = click.option(
    "--compression",
    type=click.Choice(["zstd", "lz4", "none"]),
    default="zstd",
    show_default=True,
    help="Of chunks inside the file.",
)


def _part_options(command: F) -> F:
    """Which part of a bag is meant."""
    for option in (
        click.option("--duration", "duration_s", type=click.FloatRange(0), metavar="SECONDS", help="Only so long."),
        click.option(
            "--start-offset",
            "offset_s",
            type=click.FloatRange(0),
            default=0.0,
            metavar="SECONDS",
            help="Leave out the beginning.",
        ),
        options.topics,
    ):
        command = option(command)
    return command


@click.group(no_args_is_help=True)
def bag() -> None:
    """Recordings: record, play, info, convert, migrate, reindex; as tables: table, sql.

    Bags are MCAP files, and rosbag2 folders of MCAP or SQLite files.
    """


@bag.command()
@_path
@click.option(
    "-v", "--verbose", "is_verbose", is_flag=True, help="Also where the definition of each topic's type comes from."
)
@options.paths
@options.as_json
def info(**arguments: Any) -> None:
    """Print what a bag holds. One whose recorder was killed is read to the end for it.

    \b
    rosidl-py bag info my_bag
    rosidl-py bag info my_bag --json | jq '.topics[].name'
    rosidl-py bag info humble_bag --verbose --path ~/ws/src
    """
    run_command("bag.info", **arguments)


bag.add_command(record)


bag.add_command(play)


@bag.command()
@_path
@options.as_json
def reindex(**arguments: Any) -> None:
    """Write the metadata.yaml of a bag folder again, as after a crash; give a single MCAP file its index.

    A file that gets an index is written again; what it was before is kept beside it, as FILE.unindexed.

    \b
    rosidl-py bag reindex my_bag
    rosidl-py bag reindex my_bag/my_bag_3.mcap
    """
    run_command("bag.reindex", **arguments)


@bag.command(cls=options.SeveralCommand)
@_path
@click.argument("output", type=click.Path())
@click.option(
    "-s", "--storage", type=click.Choice(["mcap", "sqlite3"]), default="mcap", show_default=True, help="Of the output."
)
@_part_options
@_compression
@options.split_options
@click.option(
    "--without-definitions",
    is_flag=True,
    help="Also copy topics whose types are known nowhere; nobody can read them without these.",
)
@options.paths
@options.as_json
def convert(**arguments: Any) -> None:
    """Write a bag again: SQLite as MCAP or the reverse, a part of it, a whole one of one whose recorder was killed.

    OUTPUT is a folder, or a file that ends with .mcap. Types that the bag has no definition of, as those of Humble,
    are looked for in the folders of --path.

    \b
    rosidl-py bag convert old_bag new_bag
    rosidl-py bag convert humble_bag new_bag --path ~/ws/src
    rosidl-py bag convert my_bag short.mcap --topics /imu --start-offset 10 --duration 5
    """
    run_command("bag.convert", **arguments)


_skips = click.option(
    "--skip-damaged",
    "skips",
    is_flag=True,
    help="Skip messages that cannot be decoded, and damaged parts of MCAP files; the exit code is 3 then.",
)


@bag.command(cls=options.SeveralCommand)
@click.argument("bags", nargs=-1, required=True, type=click.Path(), metavar="BAG...", cls=options.SeveralArgument)
@click.option("-o", "--out", required=True, metavar="PLACE", help="A folder, or a URL that fsspec knows.")
@click.option("--include-large", is_flag=True, help="Also images and clouds, and messages that have some inside.")
@_part_options
@_skips
@click.option("--overwrite", is_flag=True, help="Replace files that are there already.")
@click.option(
    "--scheduler",
    metavar="URL",
    help="Dask scheduler whose workers do it: tls://10.0.0.1:8786. With tcp:// everybody who reaches the scheduler "
    "or a worker can run code on all of them, and as the user of this command.",
)
@click.option(
    "--workers", type=click.IntRange(1), metavar="N", help="Number of processes of this machine; 1 is this one."
)
@options.paths
@options.as_json
def table(**arguments: Any) -> None:
    """Write bags as a Parquet dataset, for polars, pandas, DuckDB and Spark. Needs the extra tables.

    There is a file for each topic and bag, PLACE/topic=.../bag=.../*.parquet; large bags have several. A bag that
    fails stops no other. Another run does what is missing or has changed. Bags may be URLs that fsspec knows, with *.
    Several processes do it where there is enough to do; they open no port. Workers of a Dask cluster need the extra
    cluster.

    \b
    rosidl-py bag table my_bag --out dataset
    rosidl-py bag table drives/*.mcap --out dataset --topics /imu /odom
    rosidl-py bag table 's3://fleet/2026-*/*.mcap' --out s3://tables/fleet --scheduler tls://10.0.0.1:8786
    """
    require(*(["distributed"] if arguments["scheduler"] else []), "pyarrow")
    run_command("bag.table", **arguments)


@bag.command()
@click.argument("words", nargs=-1, required=True, type=click.Path(), metavar="QUERY BAG...")
@click.option(
    "-f",
    "--format",
    "form",
    type=click.Choice(["table", "csv", "json", "parquet"]),
    help="table unless --output has an ending; json is a line for each row.",
)
@click.option("-o", "--output", type=click.Path(), metavar="FILE", help="Instead of standard output.")
@click.option(
    "--memory-limit",
    default="1GB",
    show_default=True,
    metavar="SIZE",
    help="Of DuckDB, as 500MB or 8GiB; what needs more goes through a temporary folder, where that is possible.",
)
@_skips
@options.paths
@options.as_json
def sql(**arguments: Any) -> None:
    """Ask bags, or a dataset that `bag table` has written, with the SQL of DuckDB. Needs the extra tables.

    Topics are tables, nested fields are a.b, and each table has columns log_time, publish_time and bag. The query
    comes first or last; show tables lists the topics. --json prints a line for each row.

    \b
    rosidl-py bag sql 'select log_time, linear_acceleration.x from "/imu" limit 5' my_bag
    rosidl-py bag sql 'select max(twist.twist.linear.x) from odom' dataset --format csv
    rosidl-py bag sql my_bag 'show tables'
    """
    require("pyarrow")
    run_command("bag.sql", **arguments)


@bag.command(cls=options.SeveralCommand)
@_path
@click.option(
    "--path",
    "paths",
    multiple=True,
    required=True,
    metavar="DIR",
    help="A folder with the new definitions; may be given several times.",
)
@click.option("-o", "--output", type=click.Path(), help="A folder, or a file that ends with .mcap.")
@click.option("--rules", "rules_file", type=click.Path(), metavar="FILE", help="YAML: what types and fields are now.")
@click.option(
    "--old-path",
    "old_paths",
    multiple=True,
    metavar="DIR",
    help="A folder with the definitions of then, for bags that do not have theirs; may be given several times.",
)
@options.topics
@_compression
@options.split_options
@click.option("--dry-run", is_flag=True, help="Only say what would be carried over, dropped and defaulted.")
@options.as_json
def migrate(**arguments: Any) -> None:
    """Carry a recording over to changed definitions, field by field, by their names.

    What is dropped, and what gets its default value, is listed. A file of rules says which types and fields have other
    names now:

    \b
    types:
      my_msgs/msg/Wheel: my_msgs/msg/WheelState
    fields:
      my_msgs/msg/Wheel:
        name: label
        debug: null     # let go

    \b
    rosidl-py bag migrate drive --path ~/robot_ws/src -o drive_now
    rosidl-py bag migrate drive --path ~/robot_ws/src --rules renames.yaml --dry-run
    """
    if arguments["output"] is None and not arguments["dry_run"]:
        raise click.UsageError("say where to write: --output, or --dry-run")
    run_command("bag.migrate", **arguments)
