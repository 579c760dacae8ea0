"""Files of keystores and policies: written completely or not at all, relative links, access of other users, locks."""

from __future__ import annotations

import os
import stat
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.command_support import CommandError

if TYPE_CHECKING:
    from collections.abc import Iterator


def write_file(path: Path, data: bytes, *, is_private: bool = False) -> None:
    """Write a file that only its owner can write, and that others can read as far as the umask permits.

    Args:
        is_private: True if only the owner can read the file.
    """
    temporary = ""
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=".new-", dir=path.parent)  # with mode 0600
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        # mkstemp applies the umask, too, which may have removed permissions of the user.
        os.chmod(temporary, 0o600 | (0 if is_private else 0o644 & ~umask))
        os.replace(temporary, path)
        temporary = ""
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        if temporary:
            with suppress(OSError):
                os.unlink(temporary)


def link(path: Path, target: Path) -> None:
    """Make `path` a relative symbolic link to `target`, unless both are the same file already."""
    if path.exists() and target.exists() and path.samefile(target):
        return
    relative = os.path.relpath(target, path.parent)
    temporary = str(path.with_name(f".new-{os.getpid()}-{path.name}"))
    try:
        os.symlink(relative, temporary)
        os.replace(temporary, path)
    except OSError as error:
        hint = "; Windows needs Developer Mode for it" if os.name == "nt" else ""
        text = f"{path}: cannot create a symbolic link to {relative}: {error.strerror}{hint}"
        raise CommandError(text) from None
    finally:
        with suppress(OSError):
            os.unlink(temporary)


def is_readable_by_others(path: Path) -> bool:
    """Return True if a file exists and its mode gives its group or other users any permission."""
    with suppress(OSError):
        return os.name != "nt" and bool(stat.S_IMODE(path.stat().st_mode) & 0o077)
    return False


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a keystore in the block, so that other commands wait.

    Has no effect if locks are not supported.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
