"""Hints for missing extras: a command that installs from the source of this package."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, PathDistribution
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from support.folders import ROOT

from rosidl_py_gen.base.extras import Extra

if TYPE_CHECKING:
    from collections.abc import Callable

METADATA = """\
Metadata-Version: 2.4
Name: rosidl-py-gen
Version: 0.1.0
Requires-Dist: click>=8.1
Requires-Dist: cyclonedds<12,>=11.0.1; extra == 'node'
Requires-Dist: pyyaml>=6.0; (os_name != 'x') and extra == 'node'
Requires-Dist: mcap<2,>=1.6; extra == 'mcap'
Requires-Dist: rosidl-py-gen[node]; extra == 'mcap'
"""
NO_LIBRARY = "import rosidl_py_gen.runtime.transport.cyclone.library as m; m.candidates = lambda environ: iter(())"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], None]:

    def install(origin: Any) -> None:
        folder = tmp_path / "rosidl_py_gen-0.1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(METADATA)
        if origin is not None:
            (folder / "direct_url.json").write_text(origin if isinstance(origin, str) else json.dumps(origin))
        monkeypatch.setattr("importlib.metadata.distribution", lambda name: PathDistribution(folder))

    return install


def test_install_command_names_package_if_installed_from_index(installed: Callable[[Any], None]) -> None:
    installed(None)
    assert Extra("mcap").install_command() == "pip install 'rosidl-py-gen[mcap]'"


@pytest.mark.parametrize(("editable", "words"), [(True, ["-e"]), (False, [])])
def test_install_command_names_folder_if_installed_from_folder(
    installed: Callable[[Any], None], tmp_path: Path, editable: bool, words: list[str]
) -> None:
    folder = tmp_path / "a folder's name"
    folder.mkdir()
    installed({"url": folder.as_uri(), "dir_info": {"editable": True} if editable else {}})
    assert shlex.split(Extra("mcap").install_command()) == ["pip", "install", *words, f"{folder}[mcap]"]


def test_install_command_names_wheel_if_installed_from_wheel(installed: Callable[[Any], None], tmp_path: Path) -> None:
    wheel = tmp_path / "rosidl_py_gen-0.1.0-py3-none-any.whl"
    wheel.touch()
    installed({"url": wheel.as_uri(), "archive_info": {}})
    assert shlex.split(Extra("mcap").install_command()) == ["pip", "install", f"{wheel}[mcap]"]


def test_install_command_names_commit_if_installed_from_repository(installed: Callable[[Any], None]) -> None:
    installed({"url": "https://example.org/r.git", "vcs_info": {"vcs": "git", "commit_id": "abc"}})
    assert Extra("mcap").install_command() == "pip install 'rosidl-py-gen[mcap] @ git+https://example.org/r.git@abc'"


def test_install_command_lists_requirements_if_origin_is_missing(
    installed: Callable[[Any], None], tmp_path: Path
) -> None:
    installed({"url": (tmp_path / "gone").as_uri(), "dir_info": {}})
    needed = ["mcap<2,>=1.6", "cyclonedds<12,>=11.0.1", "pyyaml>=6.0; (os_name != 'x')"]
    assert shlex.split(Extra("mcap").install_command()) == ["pip", "install", *needed]


@pytest.mark.parametrize("broken", ["", "[", "[]", "5", '{"url": 5}'])
def test_install_command_tolerates_broken_direct_url_metadata(installed: Callable[[Any], None], broken: str) -> None:
    installed(broken)
    assert Extra("mcap").install_command().startswith("pip install ")


def test_install_command_in_checkout_is_editable_install_of_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = ["pip", "install", "-e", f"{ROOT}[mcap]"]
    assert shlex.split(Extra("mcap").install_command()) == expected  # tests run in an editable install

    def missing(name: str) -> object:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.distribution", missing)
    assert shlex.split(Extra("mcap").install_command()) == expected


@pytest.mark.parametrize(
    ("missing", "program", "extra"),
    [
        ("mcap", "import rosidl_py_gen.bags", "mcap"),
        pytest.param(
            *("zstandard", "from rosidl_py_gen.bags import BagReader", "mcap"),
            marks=pytest.mark.skipif(sys.version_info >= (3, 14), reason="Python has zstd itself"),
        ),
        ("yaml", "import rosidl_py_gen.runtime.parameters.files", "node"),
        ("cyclonedds", f"{NO_LIBRARY}; import rosidl_py_gen.runtime as r; r.Context(transport='dds')", "node"),
        ("zenoh", "import rosidl_py_gen.runtime as r; r.Context(transport='zenoh')", "zenoh"),
        ("xxhash", "import rosidl_py_gen.runtime as r; r.Context(transport='zenoh')", "zenoh"),
        ("zenoh", "from rosidl_py_gen.runtime import ZenohRouter; ZenohRouter({}, print)", "zenoh"),
    ],
)
def test_missing_module_error_contains_install_command_of_extra(missing: str, program: str, extra: str) -> None:
    lines = [
        f"import sys; sys.modules[{missing!r}] = None",
        "from rosidl_py_gen import ExtraMissingError",
        f"try: {program}",
        "except ExtraMissingError as error: print(error.name, error)",
    ]
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.startswith(f"{missing} ") and Extra(extra).install_command() in done.stdout, done.stderr


def test_all_names_of_the_runtime_can_be_imported_without_a_transport() -> None:
    extras = ["zenoh", "xxhash", "cyclonedds"]
    program = (
        f"import sys; sys.modules.update(dict.fromkeys({extras})); from rosidl_py_gen.runtime import *; print(Node)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.endswith(".Node'>\n"), done.stderr


def test_missing_module_of_no_extra_has_no_hint() -> None:
    assert Extra.missing_error(ModuleNotFoundError("No module named 'nope'", name="nope")) is None


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (("bag", "table", "x", "--out", "y"), "tables"),
        (("bag", "sql", "x", "y"), "tables"),
        (("bag", "table", "x", "--out", "y", "--scheduler", "tcp://127.0.0.1:1"), "cluster"),
        (("bag", "table", "x", "--out", "y", "--workers", "2"), "tables"),
        (("foxglove",), "foxglove"),
        (("security", "create_keystore", "/nowhere/x"), "security"),
    ],
)
def test_hint_names_extra_that_includes_other_missing_extras(arguments: tuple[str, ...], extra: str) -> None:
    code = f"""
import importlib.util, sys
real = importlib.util.find_spec
gone = set("pyarrow duckdb fsspec upath mcap zstandard lz4 dask loky distributed websockets cryptography".split())
importlib.util.find_spec = lambda name, *more: None if name in gone else real(name, *more)
for name in gone:
    sys.modules[name] = None
from rosidl_py_gen.ros_cli import main
main({list(arguments)!r})
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.returncode == 1 and f"[{extra}]" in found.stderr and found.stderr.count("\n") == 1, found.stderr
