"""Packages whose modules load when a name is first used."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest


def test_attribute_error_of_a_module_is_reported_with_its_module_and_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "lazy_package"
    package.mkdir()
    (package / "__init__.py").write_text(
        "from rosidl_py_gen.cdr.lazy import lazy_exports\n"
        "__getattr__, __dir__ = lazy_exports(__name__, {'Thing': 'broken'})\n"
    )
    (package / "broken.py").write_text("raise AttributeError('a library lacks a function')\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ImportError, match=r"^lazy_package\.broken: a library lacks a function$") as error:
        _ = import_module("lazy_package").Thing
    assert isinstance(error.value.__cause__, AttributeError)
