"""The generated files of the odd cases are the reviewed ones; ``python tests/golden/regenerate.py`` renews them."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from golden.regenerate import HERE, PACKAGES, fresh, texts
from support.interface_packages import assert_clean, importable, mypy

from rosidl_py_gen import decode, encode, type_hash

RENEW = "run `python tests/golden/regenerate.py` and read the difference"
RECORDED = texts(HERE / "generated")


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("golden") / "out"
    fresh(folder)
    with importable(folder):
        yield folder


def test_there_are_golden_files_for_every_interface(out: Path) -> None:
    assert sorted(RECORDED) == sorted(texts(out)), RENEW
    assert len(RECORDED) > 15


@pytest.mark.parametrize("name", RECORDED)
def test_a_generated_file_is_the_recorded_one(out: Path, name: str) -> None:
    assert texts(out)[name] == RECORDED[name], RENEW


def test_the_odd_cases_are_clean_code(out: Path) -> None:
    assert_clean(out)
    mypy(out, *[part for package in PACKAGES for part in ("-p", package)])


def test_the_odd_cases_work(out: Path) -> None:
    for kind in ("msg", "srv", "action"):
        package = importlib.import_module(f"odd_msgs.{kind}")
        for name in package.__all__:
            cls = getattr(package, name)
            assert type_hash(cls).startswith("RIHS01_")
            if hasattr(cls, "encode"):
                assert decode(cls, encode(cls())) == cls()
