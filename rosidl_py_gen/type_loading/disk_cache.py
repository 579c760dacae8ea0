"""Disk caches of compiled message modules, type descriptions, share folders and prefixes.

Programs run cached code, so a process of this user must have written it. `_cache_problem` checks this for every kind of
cached folder: no other user may be able to change the folder, its path, or the folder of all caches. New folders have
mode 0700 for any umask. Where files have no owners, as on Windows, no code is cached.

A cached module is used only if all its definitions have the digests that they had when it was stored. Code that reads a
cached type description must compute its RIHS01 hash and compare it with the expected one.
"""

from __future__ import annotations

import atexit
import hashlib
import importlib.util
import marshal
import os
import stat
import sys
import warnings
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING

from rosidl_py_gen import __version__
from rosidl_py_gen.base import folder_trust
from rosidl_py_gen.base.resources import DataFolders

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

VARIABLE = "ROSIDL_PY_GEN_CACHE"
"""Environment variable with the folder of all caches; the value ``off`` disables all caches."""
_KINDS = ("modules", "prefix", "share", "types")
"""Names of the folders in the folder of all caches, one for each kind of cache."""
_CURE = f"correct the mode or the owner, or set {VARIABLE} to a folder of the user"
"""Advice for a cache folder that is not used because other users can change it."""
Parts = dict[str, str]
"""Interfaces from which a cached module was compiled, by full name, each with the digest of its definition text."""
_MAX_MODULES = 4000
_MAX_FILE_BYTES = 16 << 20
MAX_DESCRIPTIONS = 2000
_DESCRIPTION = ".cdr"


def _cache_home() -> Path | None:
    """Return the folder of all caches; None if caches are disabled."""
    chosen = os.environ.get(VARIABLE, "")
    if chosen == "off":
        return None
    try:
        return Path(chosen).absolute() if chosen else _platform_folder() / "rosidl-py-gen"
    except (RuntimeError, FileNotFoundError):  # there is no home directory, or the current folder was deleted
        return None


def _platform_folder() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    cache = os.environ.get("XDG_CACHE_HOME", "")
    return Path(cache) if os.path.isabs(cache) else Path.home() / ".cache"


def _cache_problem(folder: Path) -> str:
    """Return a text that states why a cache folder must not be used; "" if no other user can change it.

    Args:
        folder: the folder of all caches or a folder in it; it may not exist.
    """
    home = _cache_home()
    if home is None:
        return "caches are disabled"
    # The path first: until it is trusted, another user may replace what is checked next.
    problem, real = folder_trust.resolve_trusted(home)
    problem = problem or folder_trust.own_folder_reason(real)
    return problem if problem or folder == home else folder_trust.own_folder_reason(folder)


def _usable_folder(kind: str) -> Path | None:
    """Return the folder for one kind of cached data, which may not exist yet; None if it must not be used."""
    home = _cache_home()
    return None if home is None or _cache_problem(home / kind) else home / kind


def _make_usable(folder: Path) -> str:
    """Create a cache folder unless it exists.

    Returns a text that states why the folder must not be used, or "" if it can be used.
    """
    if problem := _cache_problem(folder):
        return problem
    try:
        folder_trust.make_folder(folder)
    except (OSError, ValueError) as error:
        return f"{folder} cannot be created: {getattr(error, 'strerror', None) or error}"
    return _cache_problem(folder)  # in a folder as /tmp another user may have been faster


class CacheFolder:
    """Folder of one prefix or share folder in the caches, or a temporary replacement; other users cannot change it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, kind: str, words: Iterable[object]) -> CacheFolder:
        """Create the folder that belongs to some key words, with mode 0700, unless it exists.

        If caches are disabled, or other users can change the folder of the caches, the folder is a temporary folder of
        this process; in the second case with a warning. Raises OSError if no folder can be created.
        """
        name = hashlib.sha256(os.fsencode("\n".join(map(str, words)))).hexdigest()[:24]
        home = _cache_home()
        if home is not None:
            problem = _make_usable(home / kind)
            if not problem:
                _claim(home / kind / name)
                return cls(home / kind / name)
            warn_once(problem)
        folder = temporary_home() / kind / name
        folder_trust.make_folder(folder)
        return cls(folder)

    def is_usable(self) -> bool:
        """Return True if the folder exists, is in the caches, and cannot be entered by other users."""
        home, above = _cache_home(), self.path.parent
        if home is None or above.parent != home or _cache_problem(above) or _cache_problem(self.path):
            return False
        return _is_private(self.path)

    @staticmethod
    def problems() -> list[tuple[str, str]]:
        """Return a text about each problem that keeps caches from being used, with advice for the user."""
        home = _cache_home()
        reasons = [] if home is None else [_cache_problem(home / kind) for kind in _KINDS]
        text = f"the cache {home} is not used, so that no other user can make programs of this one run code"
        return [(f"{text}: {reason}", _CURE) for reason in dict.fromkeys(filter(None, reasons))]


def _is_private(folder: Path) -> bool:
    try:
        found = os.lstat(folder)
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and (os.name == "nt" or not found.st_mode & 0o077)


def _claim(folder: Path) -> None:
    """Create a cache folder that other users cannot enter, or remove the access of other users to an existing folder.

    If other users could write into the existing folder at any depth, it is renamed and replaced by a new folder.
    Afterwards, programs of the user may create folders of any mode in it, because other users cannot enter it.
    """
    folder_trust.make_folder(folder)
    problem = _cache_problem(folder)
    if not problem and not _is_private(folder):
        problem = folder_trust.entries_reason(folder, accepts_private_group=False)
        if not problem:
            os.chmod(folder, folder_trust.PRIVATE)
    if problem:
        number = 1
        while os.path.lexists(renamed := f"{folder}.untrusted-{number}"):
            number += 1
        os.rename(folder, renamed)
        folder_trust.make_folder(folder)
        warnings.warn(f"{problem}; so {folder} was renamed to {renamed}, and created again", stacklevel=3)


@lru_cache(maxsize=16)
def warn_once(problem: str) -> None:
    """Warn, once in a process, that a cache cannot be used because of `problem` and that a temporary folder is used
    instead.
    """
    warnings.warn(f"{problem}; a temporary folder is used instead of the cache; {_CURE}", stacklevel=4)


@lru_cache(maxsize=1)
def temporary_home() -> Path:
    """Return a temporary folder that is removed when this process ends.

    Raises OSError if other users could replace the folder.
    """
    import shutil
    import tempfile  # slow to import

    places = (tempfile.gettempdir(), "/tmp", "/var/tmp")
    reasons = [folder_trust.distrust_reason(place) for place in places]
    safe = [place for place, reason in zip(places, reasons, strict=True) if not reason and os.path.isdir(place)]
    if not safe:
        raise OSError(1, f"no temporary folder can be created: {reasons[0]}; set TMPDIR to a folder of the user")
    home = tempfile.mkdtemp(prefix="rosidl-py-gen-", dir=safe[0])
    os.chmod(home, folder_trust.PRIVATE)  # a umask may have removed permissions of the user
    process = os.getpid()

    def remove() -> None:
        if os.getpid() == process:  # not in a forked child
            shutil.rmtree(home, ignore_errors=True)

    atexit.register(remove)
    return Path(home)


def store_file(file: Path, data: bytes, *, max_files: int) -> None:
    """Write a cache file that only the user can read, and remove the oldest files with its suffix above `max_files`.

    Errors are ignored: the file is then not cached.
    """
    import tempfile  # slow to import

    with suppress(OSError, ValueError):
        folder_trust.make_folder(file.parent)
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
            os.chmod(name, 0o600)  # the umask may have removed permissions of the user
            os.replace(name, file)
        except BaseException:
            os.unlink(name)
            raise


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@lru_cache(maxsize=1)
def version() -> str:
    """Return a digest of everything that cached code depends on: the generator, its run-time support and Python's
    version.
    """
    package = Path(__file__).parents[1]
    rows: list[object] = [__version__, importlib.util.MAGIC_NUMBER]
    folders = [*(str(package / name) for name in ("base", "cdr", "compiler")), str(DataFolders.templates())]
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
    """Return the cached module of an interface; None unless it was compiled from the current definition texts.

    Args:
        text_digest: digest of the text of the interface.
        digest_of: returns the digest of the text of another interface; empty if it does not exist.
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
    """Store a compiled module in the cache, which removes its oldest modules if there are too many.

    Does nothing without a usable folder.
    """
    folder = own_folder()
    if folder is not None:
        store_checked(folder / _name(interface, text_digest), marshal.dumps((parts, code)), max_files=_MAX_MODULES)


def store_checked(file: Path, content: bytes, *, max_files: int) -> None:
    """Store a cache file together with its digest.

    Does nothing if the file is too large or other users can write to its folder.
    """
    if len(content) <= _MAX_FILE_BYTES and own_folder(create=True) is not None:
        store_file(file, digest(content).encode() + content, max_files=max_files)


def own_folder(create: bool = False) -> Path | None:
    """Return the folder of cached modules and package scans; None if the folder must not be used."""
    folder = _usable_folder("modules") if hasattr(os, "geteuid") else None
    return None if folder is None or (create and _make_usable(folder)) else folder


def read_checked(path: Path) -> bytes:
    """Return the content of a file that `store_checked` wrote.

    Raises ValueError if it is damaged or belongs to another user.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    with os.fdopen(handle, "rb") as file:
        found = os.fstat(handle)
        if not (stat.S_ISREG(found.st_mode) and folder_trust.is_own(found)):
            raise ValueError("a file of another user")
        data = file.read(_MAX_FILE_BYTES + 65)
    if digest(data[64:]).encode() != data[:64]:
        raise ValueError("the file is damaged")
    return data[64:]


def cache_folder() -> Path | None:
    """Return the folder of cached type descriptions; None if the folder must not be used."""
    return _usable_folder("" if os.environ.get(VARIABLE) else "types")


class CachedDescription:
    """Type description with a RIHS01 hash in the cache, as encoded bytes, which are not checked."""

    MAX_BYTES = 1 << 20
    """Maximum bytes of a description with its sources; the descriptions of the largest actions have 50 kB."""

    def __init__(self, type_hash: str) -> None:
        self.type_hash = type_hash

    @classmethod
    def find(cls, containing: bytes) -> Iterator[tuple[str, bytes]]:
        """Yield hash and bytes of the cached descriptions that contain the given bytes, newest first."""
        folder = cache_folder()
        if folder is None:
            return
        try:
            with os.scandir(folder) as entries:
                aged = [
                    (entry.stat().st_mtime_ns, entry.name) for entry in entries if entry.name.endswith(_DESCRIPTION)
                ]
        except (OSError, ValueError):
            return
        for _, name in sorted(aged, reverse=True):
            one = cls(name.removesuffix(_DESCRIPTION))
            data = one.load()
            if data is not None and containing in data:
                yield one.type_hash, data

    def load(self) -> bytes | None:
        """Return the bytes of the description; None if it is not cached."""
        folder = cache_folder()
        if folder is None:
            return None
        try:
            with (folder / f"{self.type_hash}{_DESCRIPTION}").open("rb") as file:
                data = file.read(self.MAX_BYTES + 1)
        except (OSError, ValueError):
            return None
        return data if len(data) <= self.MAX_BYTES else None

    def store(self, data: bytes) -> None:
        """Store the description, which removes the oldest descriptions if there are too many."""
        folder = cache_folder()
        if folder is not None and len(data) <= self.MAX_BYTES:
            store_file(folder / f"{self.type_hash}{_DESCRIPTION}", data, max_files=MAX_DESCRIPTIONS)
