"""``bag table``: bags as a Parquet dataset."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.resources import require_modules
from rosidl_py_gen.ros_cli import DAMAGED, options, report, terminal_output, verb

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.tables import DatasetsReport


@click.command("table", cls=options.MultiValueCommand)
@click.argument("bags", nargs=-1, required=True, type=click.Path(), metavar="BAG...", cls=options.SeveralArgument)
@click.option("-o", "--out", required=True, metavar="PLACE", help="A folder, or a URL that fsspec knows.")
@click.option("--include-large", is_flag=True, help="Also images and clouds, and messages that have some inside.")
@options.bag_selection
@options.skip_damaged
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

    There is a file for each topic and bag, PLACE/topic=.../bag=.../*.parquet; large bags have several. A bag that
    fails stops no other. Another run does what is missing or has changed. Bags may be URLs that fsspec knows, with *.
    Several processes do it where there is enough to do; they open no port. Workers of a Dask cluster need the extra
    cluster.

    \b
    rosidl-py bag table my_bag --out dataset
    rosidl-py bag table drives/*.mcap --out dataset --topics /imu /odom
    rosidl-py bag table 's3://fleet/2026-*/*.mcap' --out s3://tables/fleet --scheduler tls://10.0.0.1:8786
    """
    require_modules(*(["distributed"] if scheduler else []), "pyarrow")
    from rosidl_py_gen.tables import write_datasets

    if scheduler and workers:
        raise click.UsageError("a scheduler has its own workers: give --scheduler or --workers")
    with _bar() as show:
        found = write_datasets(
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
            progress=show,
        )
    _tell(found, out, as_json)
    return 1 if found.failed else DAMAGED if found.damaged else 0


@contextmanager
def _bar() -> Iterator[Callable[[float, int], None]]:
    """A bar for as many tasks as there turn out to be."""
    from rosidl_py_gen.ros_cli.bag.selection import progress_bar

    with ExitStack() as stack:
        shown: list[Callable[[float], None]] = []

        def show(done: float, count: int) -> None:
            if not shown:
                shown.append(stack.enter_context(progress_bar(count, "tasks")))
            shown[0](done)

        yield show


def _tell(found: DatasetsReport, out: str, as_json: bool) -> None:
    from rosidl_py_gen.ros_cli.bag.selection import damaged_rows

    files = [(name, one) for name, some in found.files.items() for one in some]
    left_out = [(name, *one) for name, some in found.skipped_topics.items() for one in some.items()]
    for name, topic, reason in left_out:
        terminal_output.note(f"{name}: left out {topic}: {reason}")
    if as_json:
        shown = [
            {"bag": name, "topic": one.topic, "type": one.type_name, "path": one.path, "messages": one.messages}
            for name, one in files
        ]
        missing = [{"bag": name, "topic": topic, "reason": reason} for name, topic, reason in left_out]
        failed = [{"bag": bag, "error": error} for bag, error in found.failed.items()]
        told = {"path": out, "files": shown, "left_out": missing, "failed": failed, "unchanged": found.unchanged}
        told["damaged"] = [{"bag": name, **row} for name, some in found.damaged.items() for row in damaged_rows(some)]
        terminal_output.document(told)
    elif files or found.unchanged or not found.failed:
        count, topics = sum(one.messages for _, one in files), len({one.topic for _, one in files})
        there = f"; {len(found.unchanged)} bags were there" if found.unchanged else ""
        terminal_output.line(f"{count} messages of {topics} topics in {out}{there}")
    for error in found.failed.values():
        report(error)
