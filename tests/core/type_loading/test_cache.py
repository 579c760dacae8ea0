"""Disk caches: folder, eviction, unusable folders, and folders that other users can change."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from rosidl_py_gen.base.folder_trust import make_folder
from rosidl_py_gen.type_loading import disk_cache
from rosidl_py_gen.type_loading.disk_cache import VARIABLE, CachedDescription, CacheFolder, cache_folder

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
def test_cache_folder_is_set_by_platform_or_environment_variable(
    monkeypatch: pytest.MonkeyPatch, settings: dict[str, str], folder: str | None
) -> None:
    for name in ("HOME", "XDG_CACHE_HOME", VARIABLE):
        monkeypatch.delenv(name, raising=False)
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    assert cache_folder() == (None if folder is None else Path(folder))


def test_stored_descriptions_are_loaded_and_the_oldest_are_evicted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "new" / "folder"))
    monkeypatch.setattr(disk_cache, "MAX_DESCRIPTIONS", 3)
    for age, one in enumerate(HASHES):
        assert CachedDescription(one).load() is None
        CachedDescription(one).store(one.encode())
        os.utime(tmp_path / "new" / "folder" / f"{one}.cdr", (age, age))
    assert [CachedDescription(one).load() for one in HASHES] == [None, None, *(one.encode() for one in HASHES[2:])]
    assert len(list((tmp_path / "new" / "folder").iterdir())) == 3


def test_too_large_descriptions_and_unusable_folders_are_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    CachedDescription(HASHES[0]).store(bytes(CachedDescription.MAX_BYTES + 1))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / f"{HASHES[0]}.cdr").write_bytes(bytes(CachedDescription.MAX_BYTES + 1))
    (tmp_path / f"{HASHES[1]}.cdr").mkdir()
    assert CachedDescription(HASHES[0]).load() is CachedDescription(HASHES[1]).load() is None
    CachedDescription(HASHES[1]).store(b"x")
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{HASHES[0]}.cdr", f"{HASHES[1]}.cdr"]
    for odd in ("\0", str(tmp_path / f"{HASHES[0]}.cdr"), "/proc/nowhere"):
        with monkeypatch.context() as patch:
            patch.setattr(disk_cache, "cache_folder", lambda odd=odd: Path(odd))
            CachedDescription(HASHES[2]).store(b"x")
            assert CachedDescription(HASHES[2]).load() is None


def test_failed_write_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))

    def fail(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "replace", fail)
    CachedDescription(HASHES[0]).store(b"x")
    assert list(tmp_path.iterdir()) == []


needs_owners = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners and modes")
needs_root = pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can change owners")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of all caches in a folder of the user."""
    make_folder(tmp_path / "user")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "user/caches"))
    disk_cache.warn_once.cache_clear()
    return tmp_path / "user/caches"


def give_away(path: Path) -> None:
    os.lchown(path, 65534, 65534)


CHANGES = {
    "the folder above is writable": lambda home: home.parent.chmod(0o777),
    "the caches are writable": lambda home: home.chmod(0o777),
    "the caches are writable for a group": lambda home: home.chmod(0o770),
    "the kind is writable": lambda home: [one.chmod(0o777) for one in home.iterdir()],
    "the kind is a link": lambda home: (
        [one.rename(home.parent / one.name) for one in home.iterdir()]
        and [one.symlink_to(home.parent / one.name) for one in [home / name for name in KINDS]]
    ),
}
KINDS = ("modules", "prefix", "share", "types")


@needs_owners
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_no_kind_of_cached_folder_is_used_if_other_users_can_write(
    home: Path, change: Callable[[Path], object]
) -> None:
    for kind in KINDS:
        make_folder(home / kind)
    assert disk_cache.own_folder() == home / "modules" and cache_folder() == home
    prefixes = [CacheFolder.create(kind, ["words"]).path for kind in ("prefix", "share")]
    assert [one.parent.parent for one in prefixes] == [home, home] and all(
        CacheFolder(one).is_usable() for one in prefixes
    )
    change(home)
    assert not any(CacheFolder(one).is_usable() for one in prefixes)
    assert disk_cache.own_folder() is disk_cache.own_folder(create=True) is None
    with pytest.warns(UserWarning, match="a temporary folder is used instead of the cache") as warned:
        others = [CacheFolder.create(kind, ["words"]).path for kind in ("prefix", "share")]
        others += [CacheFolder.create(kind, ["words"]).path for kind in ("prefix", "share")]
    assert len(warned) == len({str(one.message) for one in warned}) <= 2  # once for each reason
    for folder in others:
        assert home.parent not in folder.parents
        assert [stat.S_IMODE(one.stat().st_mode) for one in (folder, *folder.parents[:2])] == [0o700] * 3
        assert not CacheFolder(folder).is_usable()


@needs_owners
@pytest.mark.parametrize("mode", [0o777, 0o770])
def test_descriptions_are_neither_read_nor_written_if_other_users_can_write(home: Path, mode: int) -> None:
    CachedDescription(HASHES[0]).store(b"x")
    assert CachedDescription(HASHES[0]).load() == b"x"
    home.chmod(mode)
    CachedDescription(HASHES[1]).store(b"x")
    assert CachedDescription(HASHES[0]).load() is CachedDescription(HASHES[1]).load() is None
    assert [*CachedDescription.find(b"x")] == [] and len([*home.iterdir()]) == 1


@needs_owners
@pytest.mark.parametrize("mask", [0, 0o077, 0o777])
def test_new_cached_folders_and_files_are_private_with_any_umask(home: Path, mask: int) -> None:
    old = os.umask(mask)
    try:
        folder = CacheFolder.create("prefix", ["words"]).path
        CachedDescription(HASHES[0]).store(b"x")
        disk_cache.store_checked(home / "modules/one.scan", b"x", max_files=9)
    finally:
        os.umask(old)
    assert CachedDescription(HASHES[0]).load() == b"x" and CacheFolder(folder).is_usable()
    modes = {str(one.relative_to(home)): stat.S_IMODE(one.stat().st_mode) for one in [home, *home.rglob("*")]}
    assert {mode for name, mode in modes.items() if (home / name).is_dir()} == {0o700}
    assert {mode for name, mode in modes.items() if (home / name).is_file()} == {0o600}


@needs_owners
@pytest.mark.parametrize("mode", [0o777, 0o775, 0o757])
@pytest.mark.parametrize("place", ["", "lib", "lib/site-packages", "lib/site-packages/json.py"])
def test_a_cached_folder_that_was_writable_at_any_depth_is_replaced(home: Path, mode: int, place: str) -> None:
    folder = CacheFolder.create("prefix", ["words"]).path
    make_folder(folder / "lib/site-packages", is_private=False)
    (folder / "lib/site-packages/json.py").touch(0o644)
    folder.chmod(0o755)  # other users can enter it
    assert not CacheFolder(folder).is_usable()
    assert CacheFolder.create("prefix", ["words"]).path == folder
    assert CacheFolder(folder).is_usable() and (folder / "lib/site-packages/json.py").exists()
    folder.chmod(0o755)
    (folder / place).chmod(mode)
    with pytest.warns(UserWarning, match=r"can write into .* was renamed to .*\.untrusted-1, and created again"):
        assert CacheFolder.create("prefix", ["words"]).path == folder
    assert [*folder.iterdir()] == [] and (home / f"prefix/{folder.name}.untrusted-1/lib").is_dir()
    assert CacheFolder(folder).is_usable()


@needs_owners
def test_folders_of_any_mode_in_a_private_cached_folder_remain(home: Path) -> None:
    """Programs write into their share folder with the umask of the user."""
    folder = CacheFolder.create("share", ["words"]).path
    (folder / "maps").mkdir()
    (folder / "maps").chmod(0o777)
    assert CacheFolder.create("share", ["words"]).path == folder and (folder / "maps").is_dir()


@needs_root
@pytest.mark.parametrize("place", ["caches", "caches/prefix"])
def test_a_cache_of_another_user_is_not_used(home: Path, place: str) -> None:
    make_folder(home / "prefix")
    give_away(home.parent / place)
    with pytest.warns(UserWarning, match="belongs to user .* a temporary folder is used"):
        assert home not in CacheFolder.create("prefix", ["words"]).path.parents


@needs_root
@pytest.mark.parametrize("place", ["", "lib", "lib/json.py", "link"])
def test_a_prefix_with_files_of_another_user_is_replaced(home: Path, place: str) -> None:
    folder = CacheFolder.create("prefix", ["words"]).path
    make_folder(folder / "lib", is_private=False)
    (folder / "lib/json.py").touch()
    (folder / "link").symlink_to("/nowhere")
    folder.chmod(0o755)
    give_away(folder / place)
    with pytest.warns(UserWarning, match="was renamed"):
        assert CacheFolder.create("prefix", ["words"]).path == folder
    assert [*folder.iterdir()] == []


@needs_owners
def test_a_cache_that_cannot_be_created_is_replaced_by_a_temporary_folder(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home.touch()
    monkeypatch.setenv(VARIABLE, str(home / "below/a/file"))
    with pytest.warns(UserWarning, match="a temporary folder is used instead of the cache"):
        assert CacheFolder.create("prefix", ["words"]).path.is_dir()


@needs_owners
def test_temporary_folders_are_not_created_where_other_users_can_replace_them(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_folder(home / "open")
    (home / "open").chmod(0o777)
    monkeypatch.setenv(VARIABLE, "off")
    monkeypatch.setattr(tempfile, "tempdir", str(home / "open"))
    disk_cache.temporary_home.cache_clear()
    folder = CacheFolder.create("prefix", ["words"]).path
    disk_cache.temporary_home.cache_clear()
    assert home not in folder.parents and folder.is_dir()
