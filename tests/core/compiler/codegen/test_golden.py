"""Generated files of odd definitions equal the golden files; ``python tools/regenerate_golden.py`` renews them."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from regenerate_golden import GOLDEN, PACKAGES, fresh, texts
from support.interface_packages import assert_clean, importable, mypy

from rosidl_py_gen import decode, encode, type_hash

RENEW = "run `python tools/regenerate_golden.py` and read the difference"
RECORDED = texts(GOLDEN / "generated")


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("golden") / "out"
    fresh(folder)
    with importable(folder):
        yield folder


def test_golden_files_exist_for_every_generated_file(out: Path) -> None:
    assert sorted(RECORDED) == sorted(texts(out)), RENEW
    assert len(RECORDED) > 15


@pytest.mark.parametrize("name", RECORDED)
def test_generated_file_equals_the_golden_file(out: Path, name: str) -> None:
    assert texts(out)[name] == RECORDED[name], RENEW


@pytest.mark.slow
def test_odd_definitions_become_clean_code(out: Path) -> None:
    assert_clean(out)
    mypy(out, *[part for package in PACKAGES for part in ("-p", package)])


def test_messages_of_odd_definitions_round_trip(out: Path) -> None:
    for kind in ("msg", "srv", "action"):
        package = importlib.import_module(f"odd_msgs.{kind}")
        for name in package.__all__:
            cls = getattr(package, name)
            assert type_hash(cls).startswith("RIHS01_")
            if hasattr(cls, "encode"):
                assert decode(cls, encode(cls())) == cls()
