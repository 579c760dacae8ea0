"""Folders that other users can change, and the modes of new folders."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rosidl_py_gen.base import folder_trust
from rosidl_py_gen.base.folder_trust import distrust_reason, entries_reason, make_folder, own_folder_reason, part_reason

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners and modes")
needs_root = pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can change owners")
NOBODY = 65534


@contextmanager
def umask(mask: int) -> Iterator[None]:
    old = os.umask(mask)
    try:
        yield
    finally:
        os.umask(old)


@pytest.mark.parametrize("mask", [0, 0o002, 0o022, 0o077, 0o277, 0o777])
def test_new_folders_are_private_with_any_umask(tmp_path: Path, mask: int) -> None:
    with umask(mask):
        make_folder(tmp_path / "a/b/c")
        make_folder(tmp_path / "a/b/c")
    modes = [stat.S_IMODE(os.stat(tmp_path / one).st_mode) for one in ("a", "a/b", "a/b/c")]
    assert modes == [0o700] * 3


def test_mode_of_readable_folders_is_restricted_by_the_umask_but_keeps_owner_access(tmp_path: Path) -> None:
    for number, mask in enumerate((0, 0o022, 0o077, 0o777)):
        with umask(mask):
            make_folder(tmp_path / str(number), is_private=False)
    assert [stat.S_IMODE(os.stat(tmp_path / str(one)).st_mode) for one in range(4)] == [0o755, 0o755, 0o700, 0o700]


def test_creating_a_folder_where_a_file_exists_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FileExistsError):
        make_folder(tmp_path / "file")


@pytest.mark.parametrize("mode", [0o777, 0o757, 0o722])
@pytest.mark.parametrize("place", ["a", "a/b", "a/b/c"])
def test_folder_on_the_path_that_other_users_can_write_is_reported(tmp_path: Path, place: str, mode: int) -> None:
    make_folder(tmp_path / "a/b/c")
    assert distrust_reason(tmp_path / "a/b/c") == distrust_reason(tmp_path / "a/b/c/missing/folder") == ""
    (tmp_path / place).chmod(mode)
    text = f"other users can write into {tmp_path / place} (mode {mode:04o})"
    assert distrust_reason(tmp_path / "a/b/c") == distrust_reason(tmp_path / "a/b/c/missing") == text


def test_the_sticky_bit_protects_entries_of_the_user(tmp_path: Path) -> None:
    make_folder(tmp_path / "a/b")
    (tmp_path / "a").chmod(0o1777)
    assert distrust_reason(tmp_path / "a/b") == ""


def test_entries_of_a_folder_with_the_sticky_bit_are_not_trusted(tmp_path: Path) -> None:
    """Another user cannot replace entries of the user, but can add entries."""
    make_folder(tmp_path / "a/b")
    (tmp_path / "a").chmod(0o1777)
    text = f"other users can write into {tmp_path / 'a'} (mode 1777)"
    assert part_reason(tmp_path / "a", is_folder=True) == own_folder_reason(tmp_path / "a") == text
    assert {entries_reason(tmp_path, accepts_private_group=one) for one in (True, False)} == {text}


def test_symbolic_links_are_checked_with_all_folders_on_their_way(tmp_path: Path) -> None:
    make_folder(tmp_path / "open/inside/target")
    make_folder(tmp_path / "own")
    (tmp_path / "own/link").symlink_to("../open/inside")
    assert distrust_reason(tmp_path / "own/link/target") == ""
    (tmp_path / "open").chmod(0o777)
    assert f"into {tmp_path / 'open'} " in distrust_reason(tmp_path / "own/link/target")
    assert distrust_reason(tmp_path / "own/link/../../own") != ""
    (tmp_path / "own/loop").symlink_to("loop")
    assert "too many symbolic links" in distrust_reason(tmp_path / "own/loop")


def test_group_write_mode_is_accepted_only_for_a_private_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_folder(tmp_path / "a/b")
    (tmp_path / "a").chmod(0o770)
    for is_private, reason in ((True, ""), (False, f"other users can write into {tmp_path / 'a'} (mode 0770)")):
        monkeypatch.setattr(folder_trust, "is_private_group", lambda number, is_private=is_private: is_private)
        assert distrust_reason(tmp_path / "a/b") == reason
        assert entries_reason(tmp_path, accepts_private_group=True) == reason
        assert entries_reason(tmp_path, accepts_private_group=False) != ""
        assert own_folder_reason(tmp_path / "a") != ""


def test_own_folder_must_not_be_a_link_or_a_file(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path)
    (tmp_path / "file").touch()
    assert own_folder_reason(tmp_path) == own_folder_reason(tmp_path / "missing") == ""
    assert own_folder_reason(tmp_path / "link") == f"{tmp_path / 'link'} is a symbolic link"
    assert own_folder_reason(tmp_path / "file") == f"{tmp_path / 'file'} is not a folder"


@pytest.mark.parametrize("path", ["\0", "x" * 5000])
def test_paths_that_cannot_be_checked_are_not_trusted(path: str) -> None:
    assert distrust_reason(path) and own_folder_reason(path)


@needs_root
@pytest.mark.parametrize("place", ["a", "a/b"])
def test_folder_of_another_user_is_reported(tmp_path: Path, place: str) -> None:
    make_folder(tmp_path / "a/b")
    os.chown(tmp_path / place, NOBODY, NOBODY)
    assert distrust_reason(tmp_path / "a/b").startswith(f"{tmp_path / place} belongs to user ")
    assert entries_reason(tmp_path, accepts_private_group=True).startswith(f"{tmp_path / place} belongs to user ")


@needs_root
def test_symbolic_link_of_another_user_is_reported(tmp_path: Path) -> None:
    make_folder(tmp_path / "target")
    (tmp_path / "link").symlink_to("target")
    os.lchown(tmp_path / "link", NOBODY, NOBODY)
    assert distrust_reason(tmp_path / "link").startswith(f"{tmp_path / 'link'} is a link of user ")


@needs_root
def test_folders_of_root_are_trusted_by_other_users(tmp_path: Path) -> None:
    root = Path("/")
    if distrust_reason(root):
        pytest.skip("the root folder is writable")
    os.seteuid(NOBODY)
    try:
        assert distrust_reason("/usr/bin") == ""
        assert own_folder_reason("/usr/bin").startswith("/usr/bin belongs to user ")
    finally:
        os.seteuid(0)
