"""Compiled modules of message classes, kept on disk for the import hook.

What is read here is run, so it has to be what this user's own process wrote. Decides that the folder and the file
belong to this user and that nobody else may write to them, and that content is compared with what it was made of before
it is used. Where that cannot be said (Windows tells no owner), nothing is kept.
"""

from __future__ import annotations

import hashlib
import importlib.util
import marshal
import os
import stat
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING

from rosidl_py_gen.base.resources import templates_dir
from rosidl_py_gen.type_loading.description_cache import cache_home, evict_oldest

if TYPE_CHECKING:
    from collections.abc import Callable

Parts = dict[str, str]
"""What a module was made of: full name of each interface and the digest of its text."""

_SUFFIX = ".code"
_MAX_FILES = 4000
_MAX_BYTES = 16 << 20


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@lru_cache(maxsize=1)
def _version() -> str:
    """Of all that decides what is printed, what that calls and how it is compiled, which takes 3 ms to read."""
    package = Path(__file__).parents[1]
    folders = [package / "base", package / "cdr", package / "compiler", templates_dir()]
    suffixes = (".py", ".lark", ".jinja")
    files = sorted(path for folder in folders for path in folder.rglob("*") if path.suffix in suffixes)
    found = hashlib.sha256(importlib.util.MAGIC_NUMBER)
    for path in files:
        found.update(path.read_bytes())
    return found.hexdigest()


def _name(interface: str, text_digest: str) -> str:
    return digest(f"{_version()} {interface} {text_digest}".encode()) + _SUFFIX


def load(interface: str, text_digest: str, digest_of: Callable[[str], str]) -> tuple[Parts, CodeType] | None:
    """The module of an interface; None when there is none that was made of the same texts.

    Args:
        digest_of: what the text of an interface has now; empty when there is none.
    """
    folder = _folder()
    if folder is None:
        return None
    with suppress(OSError, ValueError, EOFError, TypeError):
        data = _read(folder / _name(interface, text_digest))
        if digest(data[64:]).encode() != data[:64]:  # broken, by a disk that was full for example
            return None
        parts, code = marshal.loads(data[64:])
        if isinstance(code, CodeType) and all(digest_of(name) == wanted for name, wanted in parts.items()):
            return parts, code
    return None


def store(interface: str, text_digest: str, parts: Parts, code: CodeType) -> None:
    """Keep a module; the oldest go when there are too many. A folder that cannot be used is no error."""
    folder = _folder(make=True)
    if folder is None:
        return
    import tempfile  # takes longer to import than a module that is kept

    content = marshal.dumps((parts, code))
    if len(content) > _MAX_BYTES:
        return
    with suppress(OSError, ValueError):
        evict_oldest(folder, _SUFFIX, _MAX_FILES)
        handle, name = tempfile.mkstemp(dir=folder, prefix="new-")  # nobody else can read or write it
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(digest(content).encode() + content)
            os.replace(name, folder / _name(interface, text_digest))
        except BaseException:
            os.unlink(name)
            raise


def _folder(make: bool = False) -> Path | None:
    """The folder, if it can be trusted."""
    home = cache_home()
    if home is None or not hasattr(os, "geteuid"):
        return None
    folder = home / "modules"
    try:
        if make:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return folder if _is_own(os.lstat(folder), stat.S_ISDIR) else None
    except (OSError, ValueError):
        return None


def _is_own(found: os.stat_result, is_kind: Callable[[int], bool]) -> bool:
    return is_kind(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022


def _read(path: Path) -> bytes:
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    with os.fdopen(handle, "rb") as file:
        if not _is_own(os.fstat(handle), stat.S_ISREG):
            raise ValueError("a file of somebody else")
        return file.read(_MAX_BYTES + 65)
