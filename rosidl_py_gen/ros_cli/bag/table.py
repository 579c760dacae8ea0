"""Command ``bag table``: writes bags as a Parquet dataset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.resources import require_modules
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.ros_cli import DAMAGED, options, terminal_output, verb
from rosidl_py_gen.ros_cli.command_support import report

if TYPE_CHECKING:
    from rosidl_py_gen.tables import DatasetsReport


@click.command("table", cls=options.MultiValueCommand)
@click.argument("bags", nargs=-1, required=True, type=click.Path(), metavar="BAG...", cls=options.SeveralArgument)
@click.option("-o", "--out", required=True, metavar="PLACE", help="Output folder, or URL of fsspec.")
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
    require_modules(*(["distributed"] if scheduler else []), "pyarrow")
    from rosidl_py_gen.ros_cli.bag.display import ProgressBar
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
    from rosidl_py_gen.ros_cli.bag.display import damaged_rows

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
