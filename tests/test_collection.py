"""What machines leave out that have no libddsc, or are no Unix: see `tests/conftest.py`."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
_spec = spec_from_file_location("the_conftest", TESTS / "conftest.py")  # "conftest" may be that of another folder
assert _spec is not None and _spec.loader is not None
conftest = module_from_spec(_spec)
_spec.loader.exec_module(conftest)


def left_out(name: str) -> bool:
    return conftest.pytest_ignore_collect(TESTS / name) is True


@pytest.fixture
def lacks(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Names of modules that are not there in this test."""
    missing: set[str] = set()
    monkeypatch.setattr(conftest, "is_there", lambda name: name not in missing)
    return missing


def test_every_file_is_collected_where_all_is_there(lacks: set[str]) -> None:
    files = [path.relative_to(TESTS).as_posix() for path in TESTS.rglob("test_*.py")]
    assert len(files) > 200 and not any(map(left_out, files))


def test_without_libddsc_files_that_import_it_are_left_out_and_few_others(lacks: set[str]) -> None:
    lacks.add("libddsc")
    assert left_out("runtime/transport/test_fast_dds_rules.py") and left_out("runtime/loop/test_bridge.py")
    assert not left_out("runtime/entities/test_services.py")
    files = [path.relative_to(TESTS).as_posix() for path in TESTS.rglob("test_*.py")]
    assert sum(map(left_out, files)) < len(files) / 15


def test_a_folder_whose_conftest_needs_unix_is_left_out_elsewhere(lacks: set[str]) -> None:
    assert not left_out("interop_rclpy")
    lacks.update(("fcntl", "resource"))
    assert left_out("interop_rclpy") and left_out("bags/test_damaged.py") and not left_out("bags")
