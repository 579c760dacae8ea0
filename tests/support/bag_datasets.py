"""Small bags, and the contents of datasets made from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import fsspec
import pyarrow.parquet as pq

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.tables import DatasetsReport

Int64: Any = get_message("std_msgs/msg/Int64")
String: Any = get_message("std_msgs/msg/String")


def bag_of(path: Path, *numbers: int, text: str = "", **options: Any) -> Path:
    """Write a bag with a message for each number, at ten times the number."""
    path.unlink(missing_ok=True)
    with BagWriter(path, **options) as made:
        for number in numbers:
            made.write("/n", Int64(data=number), 10 * number)
        if text:
            made.write("/s", String(data=text), 10 * numbers[0])
    return path


def rows(out: Path | str, topic: str = "n") -> list[tuple[str, int]]:
    """Return bag and value of all rows of a dataset, sorted, so that duplicates are visible."""
    system, root = fsspec.core.url_to_fs(str(out))
    found = []
    for path in system.glob(f"{root}/topic=%2F{topic}/*/*.parquet"):
        bag = path.split("/")[-2].removeprefix("bag=")
        with system.open(path) as stream:
            found += [(bag, value) for value in pq.ParquetFile(stream).read().column("data").to_pylist()]
    return sorted(found)


def said(report: DatasetsReport) -> tuple[list[str], list[str], list[str]]:
    """Return the names of bags that were written, that were unchanged, and that failed."""
    return sorted(report.files), sorted(report.unchanged), sorted(report.failed)
