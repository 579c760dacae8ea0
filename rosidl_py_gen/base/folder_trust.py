"""Check that no other user can change the files of a folder, and creation of such folders.

Another user can replace a file if a folder on its path is writable for this user, or a folder with a link of the path.
So each folder and link is checked, from the root of the file system on. Root and the user are trusted. In a folder with
the sticky bit, as ``/tmp``, another user can create entries, but can neither rename nor delete the entries of the user.
So such a folder may be above a folder of the user, but its own entries are not trusted.

Once the check has passed, other users cannot change its result: a path may be used afterwards without a race. Windows
has no such owners and modes: every folder passes.
"""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from itertools import takewhile
from pathlib import Path

PRIVATE = 0o700
"""Mode of folders that other users can neither read nor enter."""
_READABLE = 0o755
"""Mode of folders that other users can read and enter, as far as the umask permits."""
_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_MAX_LINKS = 40
"""Maximum number of symbolic links that are followed on a path, as in Linux."""
_MAX_ENTRIES = 200_000
"""Maximum number of entries that are checked in a folder. An entry takes about 5 us; a prefix of 100 packages has 3 000
entries."""


def distrust_reason(path: str | os.PathLike[str]) -> str:
    """Return a text that states why other users can replace a folder or change its entries; "" if they cannot.

    The end of the path may not exist. A group whose only member is the user is accepted, because some systems make all
    folders writable for such a group.
    """
    return resolve_trusted(path)[0]


def resolve_trusted(path: str | os.PathLike[str]) -> tuple[str, str]:
    """Check a path as `distrust_reason` does.

    Returns the result of the check, and the path with links resolved as far as it was checked.
    """
    place = os.fspath(path)
    if not hasattr(os, "geteuid"):
        return "", os.path.realpath(place)
    links = 0
    try:
        waiting = os.path.join(os.getcwd(), place).split(os.sep)[::-1]
        place, found = os.sep, os.lstat(os.sep)
        if not _is_trusted(place, found):
            return _distrust(place, found), place
        while waiting:
            part = waiting.pop()
            if part in ("", os.curdir):
                continue
            if part == os.pardir:
                place = os.path.dirname(place)
                continue
            entry = f"{'' if place == os.sep else place}{os.sep}{part}"
            try:
                found = os.lstat(entry)
            except FileNotFoundError:
                return "", os.path.join(entry, *(one for one in reversed(waiting) if one))
            if not _is_trusted(entry, found):
                return _distrust(entry, found), entry
            if not stat.S_ISLNK(found.st_mode):
                place = entry
                continue
            links += 1
            if links > _MAX_LINKS:
                raise ValueError("too many symbolic links")
            target = os.readlink(entry)
            place = os.sep if target.startswith(os.sep) else place
            waiting += target.split(os.sep)[::-1]
    except (OSError, ValueError) as error:
        return f"{os.fspath(path)!r} cannot be checked: {getattr(error, 'strerror', None) or error}", place
    return "", place


def own_folder_reason(folder: str | os.PathLike[str]) -> str:
    """Return a text that states why a folder is not private to the user: another owner, or writable for others.

    Returns "" if it is private or does not exist.
    """
    if not hasattr(os, "geteuid"):
        return ""
    try:
        found = os.lstat(folder)
    except FileNotFoundError:
        return ""
    except (OSError, ValueError) as error:
        return f"{os.fspath(folder)!r} cannot be checked: {getattr(error, 'strerror', None) or error}"
    return _kind_reason(folder, found) or ("" if is_own(found) else _distrust(str(folder), found))


def part_reason(path: str | os.PathLike[str], *, is_folder: bool, root: str | os.PathLike[str] = "") -> str:
    """Return a text that states why another user may have created, or can change, a file or folder.

    Returns "" if not, or if it does not exist. The folders above are not checked. A folder must not be a link. Each
    file that a link leads to must be trusted.

    Args:
        root: folder whose parents are not checked for links into it, either; empty for the folder of the file.
    """
    if not hasattr(os, "geteuid"):
        return ""
    try:
        for _ in range(_MAX_LINKS):
            found = os.lstat(path)
            if not _is_trusted(os.fspath(path), found, accepts_sticky=False):
                return _distrust(os.fspath(path), found)
            if is_folder:
                return _kind_reason(path, found)
            if not stat.S_ISLNK(found.st_mode):
                return ""
            folder = os.path.realpath(os.path.dirname(path))
            target, top = os.readlink(path), os.path.realpath(root) if root else folder
            step = os.path.join(folder, target)
            path = os.path.normpath(step)
            above = os.path.dirname(path)
            # After a link to a folder, ``..`` leads elsewhere.
            is_plain = os.pardir not in target.lstrip(os.pardir + os.sep).split(os.sep)
            if not is_plain or os.path.commonpath([top, above]) != top:
                return distrust_reason(step)
            while above != top:
                if reason := part_reason(above, is_folder=True):
                    return reason
                above = os.path.dirname(above)
        raise ValueError("too many symbolic links")
    except FileNotFoundError:
        return ""
    except (OSError, ValueError) as error:
        return f"{os.fspath(path)!r} cannot be checked: {getattr(error, 'strerror', None) or error}"


def entries_reason(folder: str | os.PathLike[str], *, accepts_private_group: bool) -> str:
    """Return a text that states why an entry of a folder, at any depth, may be from another user.

    Returns "" if there is no such entry.

    Args:
        accepts_private_group: entries may be writable for a group whose only member is the user.
    """
    if not hasattr(os, "geteuid"):
        return ""
    waiting, left = [os.fspath(folder)], _MAX_ENTRIES
    while waiting:
        place = waiting.pop()
        try:
            with os.scandir(place) as entries:
                for entry in entries:
                    found = entry.stat(follow_symlinks=False)
                    left -= 1
                    if left < 0:
                        return f"{folder} has more than {_MAX_ENTRIES} entries"
                    is_trusted = accepts_private_group and _is_trusted(entry.path, found, accepts_sticky=False)
                    if not (is_trusted or is_own(found)):
                        return _distrust(entry.path, found)
                    if stat.S_ISDIR(found.st_mode):
                        waiting.append(entry.path)
        except FileNotFoundError:  # another process of the user has removed the entry
            continue
        except OSError as error:
            return f"{place} cannot be checked: {error.strerror or error}"
    return ""


def tree_reason(folder: Path) -> str:
    """Return a text that states why other users can change the files of a folder at any depth; "" if they cannot.

    The files may be writable for a group whose only member is the user.
    """
    own = part_reason(os.path.realpath(folder), is_folder=True)
    return distrust_reason(folder) or own or entries_reason(folder, accepts_private_group=True)


def is_own(found: os.stat_result) -> bool:
    """Return True if a file with this status belongs to the user, and no group or other user can write into it."""
    is_link = stat.S_ISLNK(found.st_mode)  # the mode of a link has no meaning
    return found.st_uid == os.geteuid() and (is_link or not found.st_mode & _OTHERS)


def make_folder(folder: Path, *, is_private: bool = True) -> None:
    """Create a folder and its missing parents with permissions that let the user use them, with any umask.

    Args:
        is_private: False if groups and other users may read and enter the folders, unless the umask forbids it.
    """
    mode = PRIVATE if is_private else _READABLE
    missing = takewhile(lambda one: not os.path.lexists(one), (folder, *folder.parents))
    for one in reversed([*missing]):
        with suppress(FileExistsError):  # another process was faster
            os.mkdir(one, mode)
            if os.name != "nt":
                os.chmod(one, stat.S_IMODE(os.lstat(one).st_mode) | PRIVATE)
    if not os.path.isdir(folder):
        raise FileExistsError(17, "there is a file of this name", str(folder))


def _kind_reason(path: str | os.PathLike[str], found: os.stat_result) -> str:
    """Return a text that states why a path is not a real folder (it is a link, or a file); "" for a folder."""
    if stat.S_ISLNK(found.st_mode):
        return f"{os.fspath(path)} is a symbolic link"
    return "" if stat.S_ISDIR(found.st_mode) else f"{os.fspath(path)} is not a folder"


def _is_trusted(place: str, found: os.stat_result, *, accepts_sticky: bool = True) -> bool:
    if found.st_uid not in (0, os.geteuid()):
        return False
    if stat.S_ISLNK(found.st_mode) or not found.st_mode & _OTHERS:
        return True
    if accepts_sticky and stat.S_ISDIR(found.st_mode) and found.st_mode & stat.S_ISVTX:
        return True
    return not found.st_mode & stat.S_IWOTH and is_private_group(found.st_gid) and not _has_access_list(place)


def _has_access_list(place: str) -> bool:
    """Return True if a file has an access control list (ACL).

    Such a list may let users write although the mode names only a group.
    """
    if not hasattr(os, "listxattr"):
        return False
    try:
        return "system.posix_acl_access" in os.listxattr(place, follow_symlinks=False)
    except OSError:  # the file system has none
        return False


def is_private_group(number: int) -> bool:
    """Return True if a group has the user's name and no other member."""
    import grp
    import pwd

    try:
        user, group = pwd.getpwuid(os.geteuid()), grp.getgrgid(number)
    except (KeyError, OSError):
        return False
    return user.pw_gid == number and group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}


def _distrust(place: str, found: os.stat_result) -> str:
    is_link = stat.S_ISLNK(found.st_mode)
    if found.st_uid in (0, os.geteuid()) and not is_link and found.st_mode & _OTHERS:
        return f"other users can write into {place} (mode {stat.S_IMODE(found.st_mode):04o})"
    return f"{place} {'is a link of' if is_link else 'belongs to'} {_user(found.st_uid)}"


def _user(number: int) -> str:
    import pwd

    try:
        return f"user {pwd.getpwuid(number).pw_name}"
    except (KeyError, OSError):
        return f"user {number}"
