"""Search for the packages of a workspace."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from support.interface_packages import write
from support.program_processes import PACKAGE_XML

from rosidl_py_gen.compiler.frontend import search_path
from rosidl_py_gen.compiler.frontend.search_path import Workspace


def packages(folder: Path, *places: str) -> None:
    write(folder, {f"{place}/package.xml": PACKAGE_XML.format(place.rpartition("/")[2]) for place in places})


def test_packages_of_any_depth_are_found_except_in_packages_and_ignored_folders(tmp_path: Path) -> None:
    deep = "/".join(f"d{number}" for number in range(30))
    packages(tmp_path, "near", "near/inside", f"{deep}/far", "skipped/one", ".hidden/two", "venv/three")
    write(tmp_path, {"skipped/COLCON_IGNORE": "", "venv/pyvenv.cfg": ""})
    os.symlink(tmp_path, tmp_path / "d0" / "loop")
    found = Workspace.around(tmp_path)
    assert found is not None and found.packages == {"near": tmp_path / "near", "far": tmp_path / deep / "far"}
    assert found.roots == [tmp_path / "near", tmp_path / deep / "far"] and not found.limit_text


def test_incomplete_search_is_reported_and_finds_the_nearest_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search_path, "MAX_ENTRIES", 20)
    packages(tmp_path, "near", "many/files/far")
    write(tmp_path, {f"many/files/{number}": "" for number in range(30)})
    found = Workspace(tmp_path)
    assert found.packages == {"near": tmp_path / "near"}
    assert found.limit_text.startswith(f"{tmp_path}: searched for packages only in the first 20 files and folders; ")
