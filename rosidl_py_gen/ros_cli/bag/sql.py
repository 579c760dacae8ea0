"""Command ``bag sql``: SQL queries over bags or datasets."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import DAMAGED, options, terminal_output, verb
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    from rosidl_py_gen.tables.query import Result


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

    from rosidl_py_gen.ros_cli.bag.display import ProgressBar, opened_bag
    from rosidl_py_gen.tables.multi_bag.datasets import names_of
    from rosidl_py_gen.tables.query import Database, is_dataset, topics_in

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
        places = [*_expanded(bags)]
        datasets = [path for path in places if is_dataset(path)]
        names = names_of(path for path in places if path not in datasets)
        readers = {
            name: stack.enter_context(opened_bag(path, search_path=paths, skip_damaged=skips))
            for name, path in names.items()
        }
        topics = {topic for reader in readers.values() for topic in reader.topics}
        queried = {*topics_in(query, [*topics])}
        total = sum(
            topic.count or 0 for one in readers.values() for name, topic in one.topics.items() if name in queried
        )
        with ProgressBar("messages") as show:
            on_error = "skip" if skips else "raise"
            left_out = base.add(query, readers, datasets, on_error=on_error, progress=lambda done: show(done, total))
        for topic, reason in left_out.items():
            terminal_output.note(f"skipped {topic}: {reason}")
        _print_result(base.run(query), form, output)
    return DAMAGED if any(one.damaged for one in readers.values()) else 0


def _query_and_bags(words: Sequence[str]) -> tuple[str, Sequence[str]]:
    if len(words) < 2:
        raise click.UsageError("expected a query and a bag, as 'select * from \"/imu\"' my_bag")
    if not _is_query(words[0]) and _is_query(words[-1]):
        return words[-1], words[:-1]
    return words[0], words[1:]


def _is_query(word: str) -> bool:
    from rosidl_py_gen.bags.remote import is_url

    return len(word.split()) > 1 and not is_url(word) and not os.path.exists(word)


def _expanded(bags: Iterable[str]) -> Iterator[str]:
    from rosidl_py_gen.bags import BagError
    from rosidl_py_gen.bags.remote import is_url
    from rosidl_py_gen.tables.multi_bag.datasets import find_bags

    for bag in bags:
        if not is_url(bag) and os.path.exists(bag):
            yield bag
            continue
        sources, failed = find_bags([bag])
        for reason in failed.values():
            raise BagError(reason)
        yield from (one.place for one in sources)


def _format_of(output: str | None) -> str:
    suffix = Path(output or "").suffix.removeprefix(".")
    if output is None:
        return "table"
    if suffix not in ("csv", "json", "parquet"):
        raise CommandError(f"{output}: unknown format; pass --format, or a name that ends with .csv, .json or .parquet")
    return suffix


def _print_result(result: Result, form: str, output: str | None) -> None:
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
