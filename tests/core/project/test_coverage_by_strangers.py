"""Functions that only our own tests reach: how `tools/coverage_by_strangers.py` finds and compares them."""

from __future__ import annotations

from pathlib import Path

import pytest
from coverage_by_strangers import RECORD, SUITES, Outcome, command, functions, growth, ranges, read_record, record

MODULE = '''\
class Reader:
    """Reader."""

    def open(self, path):
        """Open."""
        if path:
            def close():
                return 1
            return close
        return None

    async def read(self): return 2


def unfinished(): ...
'''
STATEMENTS = {1, 4, 6, 7, 8, 9, 10, 12}


def test_functions_have_their_statements_without_those_of_inner_functions() -> None:
    found = {one.name: sorted(one.lines) for one in functions("bags/reader.py", MODULE, STATEMENTS)}
    assert found == {"Reader.open": [6, 7, 9, 10], "Reader.open.close": [8], "Reader.read": [12]}


def test_record_grows_by_functions_that_did_not_move_within_their_room() -> None:
    recorded = ["bags/reader.py Reader.open", "bags/common.py names", "bags/files.py names"]
    assert growth(recorded, ["bags/other.py Reader.open", "bags/other.py names", "bags/common.py names"]) == []
    assert growth(recorded, ["tables/reader.py Reader.open"]) == ["tables/reader.py Reader.open"]
    assert growth(recorded, ["bags/a.py names", "bags/b.py names", "bags/c.py names"]) == ["bags/c.py names"]


def test_record_is_read_as_written() -> None:
    entries = ["bags/reader.py Reader.open", "tf/buffer.py size"]
    text = record([Outcome("vectors", "4 passed", 1.0), Outcome("bags", "1 failed", 2.0)], entries, "9 lines")
    assert read_record(text) == ({"vectors", "bags"}, entries)
    assert "# - bags: bags of other tools: 1 failed\n" in text


def test_recorded_functions_are_sorted_and_from_known_suites() -> None:
    suites, entries = read_record(RECORD.read_text(encoding="utf-8"))
    assert suites and suites <= {*SUITES}
    assert entries and entries == sorted(set(entries))


@pytest.mark.parametrize("name", SUITES)
def test_every_suite_has_files_to_run(name: str, tmp_path: Path) -> None:
    words = command(name, tmp_path if SUITES[name].option else None, tmp_path)
    assert [word for word in words if word.endswith(".py")] or name == "definitions"


def test_lines_are_shown_as_ranges() -> None:
    assert ranges([8, 3, 5, 4]) == "3-5, 8"
