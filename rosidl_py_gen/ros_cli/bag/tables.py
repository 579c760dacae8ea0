"""Commands ``bag table``, which writes a Parquet dataset, and ``bag sql`` for SQL queries over bags or datasets."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import CommandError, report, terminal_output
from rosidl_py_gen.ros_cli import DAMAGED, options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.tables import Database, DatasetsReport


@click.command("table", cls=options.MultiValueCommand)
@click.argument("bags", nargs=-1, required=True, type=click.Path(), metavar="BAG...", cls=options.SeveralArgument)
@click.option(
    *("-o", "--output", "--out", "out"), required=True, metavar="PLACE", help="Output folder, or URL of fsspec."
)
@click.option("--include-large", is_flag=True, help="Also write images and clouds, and messages that contain them.")
@options.bag_selection
@options.skip_damaged
@click.option("--overwrite", is_flag=True, help="Replace existing files.")
@click.option(
    "--scheduler",
    metavar="URL",
    help="Dask scheduler whose workers share the work: tls://10.0.0.1:8786. With tcp://, every host that reaches the "
    "scheduler or a worker can run code on all of them, and as the user of this command.",
)
@click.option("--workers", type=click.IntRange(1), metavar="N", help="Number of local processes; 1 uses this process.")
@options.paths
@options.as_json
@verb
def table(
    bags: Sequence[str],
    out: str,
    topics: Sequence[str],
    offset_s: float,
    duration_s: float | None,
    include_large: bool,
    skips: bool,
    overwrite: bool,
    scheduler: str | None,
    workers: int | None,
    as_json: bool,
    paths: Sequence[str],
) -> int:
    """Write bags as a Parquet dataset, for polars, pandas, DuckDB and Spark. Needs the extra tables.

    Each topic of each bag is written to PLACE/topic=.../bag=.../*.parquet; large bags are split. A bag that fails does
    not stop others. A second run writes only missing or changed bags. Bags may be URLs of fsspec, with *. Several
    processes of Dask share the work if it is worth it; they open no port. A Dask cluster needs the extra cluster.

    \b
    rosidl-py bag table my_bag --out dataset
    rosidl-py bag table drives/*.mcap --out dataset --topics /imu /odom
    rosidl-py bag table 's3://fleet/2026-*/*.mcap' --out s3://tables/fleet --scheduler tls://10.0.0.1:8786
    """
    Extra.require_modules(*(["distributed"] if scheduler else []), "pyarrow")
    from rosidl_py_gen.ros_cli.bag.reading import ProgressBar
    from rosidl_py_gen.tables import write_datasets

    if scheduler and workers:
        raise click.UsageError("expected only one of --scheduler and --workers")
    with ProgressBar("bytes") as show:
        datasets = write_datasets(
            bags,
            out,
            topics=topics or None,
            include_large=include_large,
            start_offset_s=offset_s,
            duration_s=duration_s,
            on_error="skip" if skips else "raise",
            overwrite=overwrite,
            scheduler=scheduler,
            workers=workers,
            search_path=paths,
            on_bytes=show,
        )
    _report(datasets, out, as_json)
    return 1 if datasets.failed else DAMAGED if datasets.damaged else 0


def _report(datasets: DatasetsReport, out: str, as_json: bool) -> None:
    from rosidl_py_gen.ros_cli.bag.reading import damaged_rows

    files = [(name, one) for name, some in datasets.files.items() for one in some]
    left_out = [(name, *one) for name, some in datasets.skipped_topics.items() for one in some.items()]
    for name, topic, reason in left_out:
        terminal_output.note(f"{name}: skipped {topic}: {reason}")
    if as_json:
        rows = [
            {"bag": name, "topic": one.topic, "type": one.type_name, "path": one.path, "messages": one.messages}
            for name, one in files
        ]
        missing = [{"bag": name, "topic": topic, "reason": reason} for name, topic, reason in left_out]
        failed = [{"bag": bag, "error": error} for bag, error in datasets.failed.items()]
        document = {"path": out, "files": rows, "left_out": missing, "failed": failed, "unchanged": datasets.unchanged}
        document["damaged"] = [
            {"bag": name, **row} for name, some in datasets.damaged.items() for row in damaged_rows(some)
        ]
        terminal_output.document(document)
    elif files or datasets.unchanged or not datasets.failed:
        count, topics = sum(one.messages for _, one in files), len({one.topic for _, one in files})
        unchanged = f"; {pluralize(len(datasets.unchanged), 'bag')} unchanged" if datasets.unchanged else ""
        counts = f"{pluralize(count, 'message')} of {pluralize(topics, 'topic')}"
        terminal_output.line(f"{counts} in {out}{unchanged}")
    for error in datasets.failed.values():
        report(error)


_MAX_ROWS = 10_000


@click.command("sql")
@click.argument("words", nargs=-1, required=True, type=click.Path(), metavar="QUERY BAG...")
@click.option(
    "-f",
    "--format",
    "form",
    type=click.Choice(["table", "csv", "json", "parquet"]),
    help="Output format. [default: by the ending of --output, else table]; json prints a line for each row.",
)
@click.option(
    "-o",
    "--output",
    "--out",
    "output",
    type=click.Path(),
    metavar="FILE",
    help="Write to a file instead of standard output.",
)
@click.option(
    "--memory-limit",
    default="1GB",
    show_default=True,
    metavar="SIZE",
    help="Memory limit of DuckDB, such as 500MB or 8GiB; larger operations use a temporary folder if possible.",
)
@options.skip_damaged
@options.paths
@options.as_json
@verb
def sql(
    words: Sequence[str],
    as_json: bool,
    form: str | None,
    output: str | None,
    skips: bool,
    memory_limit: str,
    paths: Sequence[str],
) -> int:
    """Query bags, or a dataset of `bag table`, with the SQL of DuckDB. Needs the extra tables.

    Topics are tables, nested fields are a.b, and each table has columns log_time, publish_time and bag. The query is
    the first or the last argument; show tables lists the topics. --json prints a line for each row.

    \b
    rosidl-py bag sql 'select log_time, linear_acceleration.x from "/imu" limit 5' my_bag
    rosidl-py bag sql 'select max(twist.twist.linear.x) from odom' dataset --format csv
    rosidl-py bag sql my_bag 'show tables'
    """
    import atexit
    import gc

    Extra.require_modules("pyarrow")  # its extra has what bags need, too
    from rosidl_py_gen.ros_cli.bag.reading import ProgressBar, opened_bag
    from rosidl_py_gen.tables import Database

    query, bags = _query_and_bags(words)
    if as_json and form not in (None, "json"):
        raise click.UsageError(f"--json means --format json; expected only one of --json and --format {form}")
    atexit.unregister(gc.freeze)  # DuckDB's bindings warn at exit about objects that are still alive
    form = "json" if as_json else form or _format_of(output)
    if form == "parquet" and output is None:
        raise CommandError("--format parquet requires --output")
    if output is not None and Path(output).exists():
        raise CommandError(f"{output} exists already")
    with ExitStack() as stack:
        base = stack.enter_context(Database(memory_limit))
        names, datasets = Database.find_sources(bags)
        readers = {
            name: stack.enter_context(opened_bag(path, search_path=paths, skip_damaged=skips))
            for name, path in names.items()
        }
        with ProgressBar("messages") as show:
            on_error = "skip" if skips else "raise"
            left_out = base.add(query, readers, datasets, on_error=on_error, progress=show)
        for topic, reason in left_out.items():
            terminal_output.note(f"skipped {topic}: {reason}")
        _run_and_print(base, query, form, output)
    return DAMAGED if any(one.damaged for one in readers.values()) else 0


def _query_and_bags(words: Sequence[str]) -> tuple[str, Sequence[str]]:
    if len(words) < 2:
        raise click.UsageError("expected a query and a bag, as 'select * from \"/imu\"' my_bag")
    if not _is_query(words[0]) and _is_query(words[-1]):
        return words[-1], words[:-1]
    return words[0], words[1:]


def _is_query(word: str) -> bool:
    from rosidl_py_gen.bags import BagLocation

    return len(word.split()) > 1 and not BagLocation(word).is_url and not os.path.exists(word)


def _format_of(output: str | None) -> str:
    suffix = Path(output or "").suffix.removeprefix(".")
    if output is None:
        return "table"
    if suffix not in ("csv", "json", "parquet"):
        raise CommandError(f"{output}: unknown format; pass --format, or a name that ends with .csv, .json or .parquet")
    return suffix


def _run_and_print(base: Database, query: str, form: str, output: str | None) -> None:
    result = base.run(query)
    if output is not None:
        if form == "table":
            raise CommandError("--format table cannot be written to a file; expected csv, json or parquet")
        result.write(output, form)
    elif form != "table":
        terminal_output.records(result.json_lines() if form == "json" else result.csv_lines())
    else:
        rows = [*islice(result.rows(), _MAX_ROWS + 1)]
        if len(rows) > _MAX_ROWS:
            terminal_output.note(f"printed only the first {_MAX_ROWS} rows; --format csv prints all")
        terminal_output.table(rows[:_MAX_ROWS], *result.columns, has_names=False)
