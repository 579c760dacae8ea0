"""Reading of the definitions of a git revision into a temporary folder.

Interface files and files that define packages are read as git objects: nothing is checked out or fetched, and no filter
or hook of the repository runs. A revision is converted to the hash of a commit before it is used in other git commands.
"""

from __future__ import annotations

import os
import re
import subprocess
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.errors import RosidlError, printable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_SUFFIXES = (".msg", ".srv", ".action", ".idl")
_NAMES = ("package.xml", "CMakeLists.txt", "COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE", "pyvenv.cfg")
_MAX_FILES = 50_000
MAX_BYTES = 64 << 20
"""Maximum total size of the definitions of a revision, in bytes; all packages of ROS 2 have 10 MB of definitions."""
_HASH = re.compile(r"[0-9a-f]{40,64}\Z")
_FILE_MODES = ("100644", "100755", "100664")
_LINK_MODE = "120000"
_SUBMODULE_MODE = "160000"
_HOOK_VARIABLES = ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE", "GIT_PREFIX")
"""Environment variables that git sets for hooks, and that would redirect git to the repository of the hook."""


class RevisionError(RosidlError):
    """Raised if a git revision does not exist or cannot be read."""


class _GitTreeEntry(NamedTuple):
    mode: str
    object: str
    size: int
    path: str


@contextmanager
def checked_out(text: str, folder_in_repository: str) -> Iterator[tuple[Path | None, str, list[str]]]:
    """Write the definitions of ``REVISION`` or ``REVISION:PATH`` to a temporary folder; raises `RevisionError`.

    Without PATH, the definitions of `folder_in_repository` are written.

    Yields:
        The temporary folder, or None if the revision has no definitions; the name ``REVISION:PATH`` for texts to the
        user; notes for the user.
    """
    revision, path = _split(text)
    place = Path(folder_in_repository)
    if not place.is_dir():
        raise RevisionError(f"{folder_in_repository}: there is no such folder")
    top = Path(
        _git(
            ["rev-parse", "--show-toplevel"],
            place,
            f'"{text}" is neither a file nor a revision: {folder_in_repository}',
        )
    )
    if revision.startswith("-") or not revision:
        raise RevisionError(f'"{text}": expected a git revision, such as main, v1.2 or HEAD~1:src/my_msgs')
    if revision == "HEAD" and path is None and _is_unborn(top):
        yield None, "HEAD:", ["there is no commit yet: all definitions are new"]
        return
    commit = _git(
        ["rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}"], top, f'no revision "{revision}" in {top}'
    )
    if not _HASH.match(commit):
        raise RevisionError(f'"{revision}" does not name exactly one commit')
    inside = _inside(path, place, top)
    display = f"{revision}:{inside}" if inside else f"{revision}:"
    entries = _entries(commit, inside, top, display)
    wanted, notes = _wanted(entries or [], display)
    if not wanted:
        if path is not None:
            lacks = "is no such folder in this revision" if entries is None else "are no definitions in this folder"
            raise RevisionError(f"{printable(display)}: there {lacks}")
        lacks = "does not exist" if entries is None else "has no definitions"
        yield None, display, [*notes, f"{printable(display)} {lacks}: all definitions are new"]
        return
    with TemporaryDirectory(prefix="rosidl-py-gen-diff-") as folder:
        # A package without package.xml has the name of its folder.
        root = Path(folder) / (PurePosixPath(inside).name or top.name or "root")
        _write(root, wanted, _contents(wanted, top, display))
        yield root, display, notes


def clone_origin(folder: Path) -> tuple[str, str]:
    """Return the URL of a clone's remote `origin`, without a password, and the commit of the clone.

    A value that is unknown is "".
    """
    found = []
    for arguments in (["config", "--get", "remote.origin.url"], ["rev-parse", "--verify", "--quiet", "HEAD"]):
        try:
            done = _run(arguments, folder)
        except RevisionError:  # git is not installed
            return "", ""
        found.append("" if done.returncode else os.fsdecode(done.stdout).strip())
    return re.sub(r"(?<=://)[^/@]*@", "", found[0]), found[1]


def _is_unborn(top: Path) -> bool:
    """Return True if the repository has no commit yet, as while hooks run for the first commit."""
    if _run(["rev-parse", "--verify", "--quiet", "HEAD"], top).returncode == 0:
        return False
    listed = _run(["rev-list", "--max-count=1", "--all"], top)
    return listed.returncode == 0 and not listed.stdout.strip()


def _split(text: str) -> tuple[str, str | None]:
    """Split a text such as ``HEAD@{1 day ago}:src`` into revision and path; the path is None if the text has none."""
    depth = 0
    for number, char in enumerate(text):
        depth += (char == "{") - (char == "}")
        if char == ":" and depth <= 0:
            return text[:number], text[number + 1 :]
    return text, None


def _inside(path: str | None, place: Path, top: Path) -> str:
    """Return `path`, or `place` if it is None, relative to the top of the repository.

    Raises `RevisionError` if it is outside.
    """
    if path is None or path.startswith(("./", "../")) or path == ".":
        wanted = os.path.realpath(place if path is None else path)
        relative = os.path.relpath(wanted, os.path.realpath(top))
        found = Path(relative).as_posix()
    else:
        found = str(PurePosixPath(path)).strip("/")
    parts = [part for part in found.split("/") if part not in ("", ".")]
    if ".." in parts or "\0" in found:
        raise RevisionError(f'"{printable(found)}" is outside of {top}')
    return "/".join(parts)


def _entries(commit: str, inside: str, top: Path, display: str) -> list[_GitTreeEntry] | None:
    """Return the files of a commit below the folder `inside` of the repository.

    Returns None if the commit has no such folder.
    """
    if inside:
        kind = _run(["cat-file", "-t", f"{commit}:{inside}"], top)
        if kind.returncode or kind.stdout.strip() != b"tree":
            return None
    listed = _run(["ls-tree", "-r", "-z", "-l", f"{commit}:{inside}"], top)
    if listed.returncode:
        raise RevisionError(f"{printable(display)}: {_reason(listed)}")
    found = []
    for line in listed.stdout.split(b"\0"):
        columns, _, name = line.partition(b"\t")
        parts = columns.decode("ascii", "replace").split()
        if len(parts) == 4:
            size = int(parts[3]) if parts[3].isdigit() else 0
            found.append(_GitTreeEntry(parts[0], parts[2], size, os.fsdecode(name)))
    return found


def _wanted(entries: Sequence[_GitTreeEntry], display: str) -> tuple[list[_GitTreeEntry], list[str]]:
    relevant = [one for one in entries if one.path.endswith(_SUFFIXES) or PurePosixPath(one.path).name in _NAMES]
    wanted = [one for one in relevant if one.mode in _FILE_MODES]
    size = sum(one.size for one in wanted)
    if len(wanted) > _MAX_FILES or size > MAX_BYTES:
        raise RevisionError(
            f"{printable(display)}: has {len(wanted)} files of definitions with {size} bytes; expected at most "
            f"{_MAX_FILES} with {MAX_BYTES}: name the folder of the packages, as REVISION:PATH"
        )
    for one in wanted:
        parts = one.path.split("/")
        if any(part in ("", ".", "..") or "\\" in part or (os.name == "nt" and ":" in part) for part in parts):
            raise RevisionError(f"{printable(display)}: {printable(one.path)!r} is not a valid path")
    notes = []
    skipped = {
        "submodules are skipped": [one.path for one in entries if one.mode == _SUBMODULE_MODE],
        "links are skipped": [one.path for one in entries if one.mode == _LINK_MODE],
    }
    for what, paths in skipped.items():
        if paths:
            more = f" and {len(paths) - 3} more" if len(paths) > 3 else ""
            notes.append(printable(f"{display}: {what}: {', '.join(paths[:3])}{more}"))
    has_definitions = any(one.path.endswith(_SUFFIXES) for one in wanted)
    return wanted if has_definitions else [], notes


def _contents(wanted: Sequence[_GitTreeEntry], top: Path, display: str) -> list[bytes]:
    objects = "".join(f"{one.object}\n" for one in wanted).encode()
    done = _run(["cat-file", "--batch"], top, objects)
    found, at = [], 0
    for one in wanted:
        end = done.stdout.find(b"\n", at)
        head = done.stdout[at:end].split() if end >= 0 else []
        if len(head) != 3 or head[1] != b"blob":
            raise RevisionError(
                f"{printable(display)}: {printable(one.path)} is not in this clone, which is a partial one"
            )
        start, size = end + 1, int(head[2])
        found.append(done.stdout[start : start + size])
        at = start + size + 1
    return found


def _write(root: Path, wanted: Sequence[_GitTreeEntry], contents: Sequence[bytes]) -> None:
    for one, data in zip(wanted, contents, strict=True):
        path = root.joinpath(*one.path.split("/"))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def _git(arguments: list[str], folder: Path, otherwise: str) -> str:
    done = _run(arguments, folder)
    if done.returncode:
        reason = _reason(done)
        raise RevisionError(printable(f"{otherwise}: {reason}" if reason else otherwise))
    return os.fsdecode(done.stdout).rstrip("\n")


def _run(arguments: list[str], folder: Path, stdin: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    environment = {name: value for name, value in os.environ.items() if name not in _HOOK_VARIABLES}
    environment |= {"LC_ALL": "C", "GIT_OPTIONAL_LOCKS": "0", "GIT_NO_LAZY_FETCH": "1", "GIT_TERMINAL_PROMPT": "0"}
    try:
        return subprocess.run(["git", *arguments], cwd=folder, env=environment, input=stdin, capture_output=True)
    except FileNotFoundError:
        raise RevisionError("git is not installed, which is needed to read revisions") from None
    except ValueError:  # a NUL in an argument
        raise RevisionError("a revision must not contain NUL") from None


def _reason(done: subprocess.CompletedProcess[bytes]) -> str:
    lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
    return lines[0].removeprefix("fatal: ")[:300] if lines else ""
