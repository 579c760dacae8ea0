"""Cache of descriptions: folder, eviction, and unusable folders."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from rosidl_py_gen.type_loading import disk_cache
from rosidl_py_gen.type_loading.disk_cache import VARIABLE, cache_folder, load_description, store_description

HASHES = [f"RIHS01_{index:064x}" for index in range(5)]


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="other folders there")
@pytest.mark.parametrize(
    ("settings", "folder"),
    [
        ({"HOME": "/home/me"}, "/home/me/.cache/rosidl-py-gen/types"),
        ({"HOME": "/home/me", "XDG_CACHE_HOME": "/var/me"}, "/var/me/rosidl-py-gen/types"),
        ({"HOME": "/home/me", "XDG_CACHE_HOME": "relative"}, "/home/me/.cache/rosidl-py-gen/types"),
        ({"XDG_CACHE_HOME": "/var/me", VARIABLE: "/elsewhere"}, "/elsewhere"),
        ({VARIABLE: "off"}, None),
    ],
)
def test_the_folder_is_the_one_of_the_platform_or_the_chosen_one(
    monkeypatch: pytest.MonkeyPatch, settings: dict[str, str], folder: str | None
) -> None:
    for name in ("HOME", "XDG_CACHE_HOME", VARIABLE):
        monkeypatch.delenv(name, raising=False)
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    assert cache_folder() == (None if folder is None else Path(folder))


def test_what_is_kept_is_found_and_the_oldest_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "new" / "folder"))
    monkeypatch.setattr(disk_cache, "MAX_DESCRIPTIONS", 3)
    for age, one in enumerate(HASHES):
        assert load_description(one) is None
        store_description(one, one.encode())
        os.utime(tmp_path / "new" / "folder" / f"{one}.cdr", (age, age))
    assert [load_description(one) for one in HASHES] == [None, None, *(one.encode() for one in HASHES[2:])]
    assert len(list((tmp_path / "new" / "folder").iterdir())) == 3


def test_large_ones_and_odd_folders_are_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    store_description(HASHES[0], bytes(disk_cache.MAX_DESCRIPTION_BYTES + 1))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / f"{HASHES[0]}.cdr").write_bytes(bytes(disk_cache.MAX_DESCRIPTION_BYTES + 1))
    (tmp_path / f"{HASHES[1]}.cdr").mkdir()
    assert load_description(HASHES[0]) is load_description(HASHES[1]) is None
    store_description(HASHES[1], b"x")
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{HASHES[0]}.cdr", f"{HASHES[1]}.cdr"]
    for odd in ("\0", str(tmp_path / f"{HASHES[0]}.cdr"), "/proc/nowhere"):
        with monkeypatch.context() as patch:
            patch.setattr(disk_cache, "cache_folder", lambda odd=odd: Path(odd))
            store_description(HASHES[2], b"x")
            assert load_description(HASHES[2]) is None


def test_a_write_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))

    def fail(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "replace", fail)
    store_description(HASHES[0], b"x")
    assert list(tmp_path.iterdir()) == []
