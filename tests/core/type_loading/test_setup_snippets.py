"""Short programs with iterators, files and unknown values: the reader of setup.py against running the program.

`setup_snippets.txt` has the programs. A title that ends with "uncertain" means that the reader does not know the value.
"""

from __future__ import annotations

import importlib
import os
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from support.setup_idioms import FILES, IMPORTS, TEXTS

from rosidl_py_gen.compiler.frontend.package_files import PackageBudget
from rosidl_py_gen.type_loading.setup_reader.setup_py import read_setup_py

pytestmark = pytest.mark.skipif(os.name == "nt", reason="paths of POSIX")
_TEXT = Path(__file__).with_name("setup_snippets.txt").read_text(encoding="utf-8")
PROGRAMS = dict(re.findall(r"(?ms)^# === (.+?) ===\n(.*?)(?=^# ===|\Z)", _TEXT))
_END = "setup(name='foo', data_files=data_files)\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    top = tmp_path_factory.mktemp("foo")
    for path, text in {**{path: path for path in FILES}, **TEXTS}.items():
        (top / path).parent.mkdir(parents=True, exist_ok=True)
        (top / path).write_bytes(text.encode())
    return top


def run(code: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the `data_files` of a program that calls `setup`."""
    given: list[dict[str, Any]] = []
    setuptools: Any = ModuleType("setuptools")
    setuptools.setup = lambda **arguments: given.append(arguments)
    setuptools.find_packages = list
    monkeypatch.setitem(sys.modules, "setuptools", setuptools)
    monkeypatch.setattr(sys, "argv", ["setup.py", "install"])
    exec(compile(code, "setup.py", "exec", dont_inherit=True), {"__name__": "__main__", "__file__": "setup.py"})
    importlib.invalidate_caches()
    return given[0]["data_files"]


def plain(value: Any) -> Any:
    return [plain(one) for one in value] if isinstance(value, list | tuple) else str(value)


@pytest.mark.parametrize("title", PROGRAMS)
def test_reader_of_setup_py_returns_the_values_of_the_program_or_is_uncertain(
    title: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.delenv("NO_SUCH_VARIABLE", raising=False)
    code = f"{IMPORTS}{PROGRAMS[title]}{_END}"
    found = read_setup_py(code, folder, PackageBudget())
    is_certain = "data_files" not in found.uncertain
    if is_certain:
        assert plain(found.values["data_files"]) == plain(run(code, monkeypatch))
    assert is_certain is not title.endswith("uncertain")
