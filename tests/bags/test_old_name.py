"""`rosidl_py_gen.mcap`, the old name of `rosidl_py_gen.bags`, works and says what replaces it (docs/versioning.md)."""

from __future__ import annotations

import sys
from importlib import import_module

import pytest

from rosidl_py_gen import bags


def test_the_old_name_has_the_same_classes_and_is_deprecated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "rosidl_py_gen.mcap", raising=False)
    with pytest.warns(DeprecationWarning, match=r"import rosidl_py_gen\.bags, .*; version 1\.0 removes this") as told:
        old = import_module("rosidl_py_gen.mcap")
    assert [one.filename for one in told] != [old.__file__]
    public = {name for name in vars(bags) if name[0].isupper()}
    assert public == {name for name in vars(old) if name[0].isupper()}
    assert all(getattr(old, name) is getattr(bags, name) for name in public)
