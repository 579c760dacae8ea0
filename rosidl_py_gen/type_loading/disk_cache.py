"""Disk caches: of compiled modules of message classes for the import hook, and of type descriptions by RIHS01 hash.

Cached code is run, so a process of this user must have written it: folder and file must belong to the user and must not
be writable for others. An entry is used only if all its definitions have the digests that they had when it was stored.
Without owners of files, as on Windows, no code is cached. Descriptions may have been modified, so a reader must check
the hash.
"""

from __future__ import annotations

import hashlib
import importlib.util
import marshal
import os
import stat
import sys
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING

from rosidl_py_gen import __version__
from rosidl_py_gen.base.resources import templates_dir

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

VARIABLE = "ROSIDL_PY_GEN_CACHE"
"""Environment variable with another folder; ``off`` disables all caches."""
Parts = dict[str, str]
"""Interfaces from which a module was compiled: full name -> digest of the text."""
_MAX_MODULES = 4000
_MAX_FILE_BYTES = 16 << 20
MAX_DESCRIPTIONS = 2000
MAX_DESCRIPTION_BYTES = 1 << 20
"""Maximum size of a description with its sources; those of the largest actions have 50 kB."""
_DESCRIPTION = ".cdr"


def cache_home() -> Path | None:
    """Return the folder of all caches; None if caches are disabled."""
    chosen = os.environ.get(VARIABLE, "")
    if chosen:
        return None if chosen == "off" else Path(chosen)
    try:
        return _platform_folder() / "rosidl-py-gen"
    except RuntimeError:  # there is no home directory
        return None


def _platform_folder() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    cache = os.environ.get("XDG_CACHE_HOME", "")
    return Path(cache) if os.path.isabs(cache) else Path.home() / ".cache"


def store_file(file: Path, data: bytes, *, max_files: int) -> None:
    """Write a file that only the user can read, and remove the oldest files of its suffix; ignores errors."""
    import tempfile  # slow to import

    with suppress(OSError, ValueError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with os.scandir(file.parent) as entries:
            aged = sorted(
                (entry.stat().st_mtime_ns, entry.path) for entry in entries if entry.name.endswith(file.suffix)
            )
        for _, path in aged[: max(0, len(aged) - max_files + 1)]:
            os.unlink(path)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix="new-")
        try:
            with os.fdopen(handle, "wb") as opened:
                opened.write(data)
            os.replace(name, file)
        except BaseException:
            os.unlink(name)
            raise


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@lru_cache(maxsize=1)
def version() -> str:
    """Return a digest of the times of the generator, of the code that generated code calls, and of Python's version."""
    package = Path(__file__).parents[1]
    rows: list[object] = [__version__, importlib.util.MAGIC_NUMBER]
    folders = [str(folder) for folder in (package / "base", package / "cdr", package / "compiler", templates_dir())]
    for folder in folders:  # grows inside the loop
        with os.scandir(folder) as entries:
            for entry in sorted(entries, key=lambda entry: entry.name):
                if entry.name.endswith((".py", ".lark", ".jinja")):
                    rows.append((entry.path, entry.stat().st_mtime_ns, entry.stat().st_size))
                elif entry.is_dir():
                    folders.append(entry.path)
    return digest(repr(rows).encode(errors="surrogatepass"))


def _name(interface: str, text_digest: str) -> str:
    return digest(f"{version()} {interface} {text_digest}".encode()) + ".code"


def load_code(interface: str, text_digest: str, digest_of: Callable[[str], str]) -> tuple[Parts, CodeType] | None:
    """Return the cached module of an interface; None unless it was compiled from the same texts.

    `digest_of` returns the digest of the text of another interface; empty if it does not exist.
    """
    folder = own_folder()
    if folder is None:
        return None
    with suppress(OSError, ValueError, EOFError, TypeError):
        parts, code = marshal.loads(read_checked(folder / _name(interface, text_digest)))
        if isinstance(code, CodeType) and all(digest_of(name) == wanted for name, wanted in parts.items()):
            return parts, code
    return None


def store_code(interface: str, text_digest: str, parts: Parts, code: CodeType) -> None:
    """Store a module, and remove the oldest modules if there are too many; does nothing without a usable folder."""
    folder = own_folder()
    if folder is not None:
        store_checked(folder / _name(interface, text_digest), marshal.dumps((parts, code)), max_files=_MAX_MODULES)


def store_checked(file: Path, content: bytes, *, max_files: int) -> None:
    """Store a file with its digest, unless it is too large or its folder is not that of the user alone."""
    if len(content) <= _MAX_FILE_BYTES and own_folder(create=True) is not None:
        store_file(file, digest(content).encode() + content, max_files=max_files)


def own_folder(create: bool = False) -> Path | None:
    """Return the folder of the cache; None without one, or if others than the user can write into it."""
    home = cache_home()
    if home is None or not hasattr(os, "geteuid"):
        return None
    folder = home / "modules"
    try:
        if create:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return folder if _is_own(os.lstat(folder), stat.S_ISDIR) else None
    except FileNotFoundError:
        return folder
    except (OSError, ValueError):
        return None


def _is_own(found: os.stat_result, is_kind: Callable[[int], bool]) -> bool:
    return is_kind(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022


def read_checked(path: Path) -> bytes:
    """Return the content of a file of `store_checked`; raises ValueError if it is damaged or of another user."""
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    with os.fdopen(handle, "rb") as file:
        if not _is_own(os.fstat(handle), stat.S_ISREG):
            raise ValueError("a file of another user")
        data = file.read(_MAX_FILE_BYTES + 65)
    if digest(data[64:]).encode() != data[:64]:
        raise ValueError("the file is damaged")
    return data[64:]


def cache_folder() -> Path | None:
    """Return the folder of the descriptions; None if caches are disabled."""
    home = cache_home()
    return home if home is None or os.environ.get(VARIABLE) else home / "types"


def load_description(type_hash: str) -> bytes | None:
    """Return the cached description of a hash; None if there is none."""
    folder = cache_folder()
    if folder is None:
        return None
    try:
        with (folder / f"{type_hash}{_DESCRIPTION}").open("rb") as file:
            data = file.read(MAX_DESCRIPTION_BYTES + 1)
    except (OSError, ValueError):
        return None
    return data if len(data) <= MAX_DESCRIPTION_BYTES else None


def cached_descriptions(containing: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield hash and data of the cached descriptions that contain some bytes, newest first."""
    folder = cache_folder()
    if folder is None:
        return
    try:
        with os.scandir(folder) as entries:
            aged = [(entry.stat().st_mtime_ns, entry.name) for entry in entries if entry.name.endswith(_DESCRIPTION)]
    except (OSError, ValueError):
        return
    for _, name in sorted(aged, reverse=True):
        type_hash = name.removesuffix(_DESCRIPTION)
        data = load_description(type_hash)
        if data is not None and containing in data:
            yield type_hash, data


def store_description(type_hash: str, data: bytes) -> None:
    """Store an encoded description, and remove the oldest descriptions if there are too many."""
    folder = cache_folder()
    if folder is not None and len(data) <= MAX_DESCRIPTION_BYTES:
        store_file(folder / f"{type_hash}{_DESCRIPTION}", data, max_files=MAX_DESCRIPTIONS)
