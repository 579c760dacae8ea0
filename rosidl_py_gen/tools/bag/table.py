"""``bag table``: bags as a Parquet dataset."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.tables.dataset import DatasetReport, bag_name, write_dataset
from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.bag.part import part_of, progress_bar

if TYPE_CHECKING:
    from collections.abc import Callable


def run(
    bags: Sequence[str],
    out: str,
    topics: Sequence[str],
    offset_s: float,
    duration_s: float | None,
    include_large: bool,
    skips: bool,
    overwrite: bool,
    as_json: bool,
    paths: Sequence[str],
) -> int:
    """Returns the exit code."""
    names = names_of(bags)
    with ExitStack() as stack:
        readers = {name: stack.enter_context(BagReader(path, search_path=paths)) for name, path in names.items()}
        total = sum(one.count or 0 for reader in readers.values() for one in reader.topics.values())
        done, reports = 0, {}
        with progress_bar(total) as show:
            for name, reader in readers.items():
                part = part_of(reader, [one for one in topics if one in reader.topics], offset_s, duration_s)
                if topics and not any(one in reader.topics for one in topics):
                    part_of(reader, topics, offset_s, duration_s)  # which says so
                reports[name] = write_dataset(
                    reader,
                    out,
                    name=name,
                    topics=part.topics if topics else None,
                    include_large=include_large,
                    start_ns=part.start_ns,
                    end_ns=part.end_ns,
                    on_error="skip" if skips else "raise",
                    overwrite=overwrite,
                    progress=_shifted(show, done),
                )
                done += sum(one.count or 0 for one in reader.topics.values())
                show(done)
    _tell(reports, out, as_json)
    return 0


def _shifted(show: Callable[[int], None], done: int) -> Callable[[int], None]:
    return lambda count: show(done + count)


def _tell(reports: dict[str, DatasetReport], out: str, as_json: bool) -> None:
    files = [(name, one) for name, report in reports.items() for one in report.files]
    left_out = [(name, *one) for name, report in reports.items() for one in report.left_out.items()]
    for name, topic, reason in left_out:
        printing.note(f"{name}: left out {topic}: {reason}")
    if as_json:
        shown = [
            {"bag": name, "topic": one.topic, "type": one.type_name, "path": one.path, "messages": one.messages}
            for name, one in files
        ]
        missing = [{"bag": name, "topic": topic, "reason": reason} for name, topic, reason in left_out]
        printing.document({"path": out, "files": shown, "left_out": missing})
        return
    count, topics = sum(one.messages for _, one in files), len({one.topic for _, one in files})
    printing.line(f"{count} messages of {topics} topics in {out}")


def names_of(bags: Sequence[str]) -> dict[str, str]:
    """A name for each bag that no other has: that of its file, with folders before it where that is not enough."""
    paths = list(dict.fromkeys(bags))
    parts = [[bag_name(part) for part in Path(path).absolute().parts[1:]] or ["bag"] for path in paths]
    names = {}
    for path, own in zip(paths, parts, strict=True):
        length = 1
        while length < len(own) and sum(own[-length:] == other[-length:] for other in parts) > 1:
            length += 1
        name = "/".join(own[-length:])
        names[name if name not in names else path] = path
    return names
