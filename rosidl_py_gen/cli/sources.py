"""Where `diff` takes definitions from: a folder, a git revision, a bag, or a running node.

Decides what a text stands for: what `folder:`, `git:`, `bag:` or `node:` in front of it says; else a file or folder
that is there, then a node when it begins with ``/``, then a revision. A folder and a revision are all the definitions
there are; a bag and a node show some.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cli import revision
from rosidl_py_gen.compiler.changes.facts import Facts, as_recorded, facts_of, facts_with_needs, joined
from rosidl_py_gen.compiler.generate import load, notes_of
from rosidl_py_gen.compiler.spec.definition import read_checked
from rosidl_py_gen.compiler.spec.find import search_path
from rosidl_py_gen.compiler.spec.resolve import Library
from rosidl_py_gen.errors import DefinitionError, Problem, RosidlError, TypeNotFoundError, shown_path

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.compiler.spec.find import SearchPath

KINDS = ("folder", "git", "bag", "node")
_BAG_FILES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_METADATA = "metadata.yaml"


class SourceError(RosidlError):
    """What was given to compare is not there, or cannot be read; the text says why."""


class Source(NamedTuple):
    """What is compared: one of `KINDS`, and a path, revision or node name."""

    kind: str
    text: str

    @property
    def is_whole(self) -> bool:
        """Whether a type that it does not have does not exist."""
        return self.kind in ("folder", "git")


@dataclass(slots=True)
class Found:
    """The definitions of a source, with what has to be said of them."""

    facts: Facts
    search: SearchPath | None = None
    notes: list[str] = field(default_factory=list)

    def with_types(self, names: Iterable[str]) -> Found:
        """Those of the names that the search path has beside its own: a bag may use any of them.

        Raises:
            DefinitionError: one of them has problems.
        """
        if self.search is None:
            return self
        library, parts = Library(self.search), [("", self.facts)]
        for name in names:
            if name in self.facts.interfaces:
                continue
            try:
                owner = read_checked(library, split_ros_name(name))
            except TypeNotFoundError:
                continue
            found = facts_of(library, [owner])
            # Recordings of X_Event and the like may have no more than this message of X.
            interfaces = found.interfaces if str(owner) == name else {name: (name,)}
            parts.append(("", Facts(interfaces, found.messages, found.hashes)))
        return Found(joined(parts), self.search, self.notes)


def source_of(text: str) -> Source:
    """What a text stands for.

    Raises:
        SourceError: nothing.
    """
    kind, colon, rest = text.partition(":")
    if colon and kind in KINDS:
        if not rest:
            raise SourceError(f'"{text}": expected something behind {kind}:')
        return Source(kind, rest)
    path = Path(text)
    if path.is_dir():
        return Source("bag" if _is_bag(path) else "folder", text)
    if path.exists():
        if text.endswith(_BAG_FILES):
            return Source("bag", text)
        raise SourceError(f"{text}: a file that is no bag; expected a folder of packages, {', '.join(_BAG_FILES)}")
    if text.startswith("/"):
        return Source("node", text)
    if text.endswith(_BAG_FILES) or text.startswith((".", "~")):
        raise SourceError(f"{text}: there is no such file or folder")
    return Source("git", text)


def _is_bag(folder: Path) -> bool:
    if (folder / "package.xml").is_file():
        return False
    return (folder / _METADATA).is_file() or any(one.name.endswith(_BAG_FILES) for one in folder.iterdir())


@contextmanager
def opened(old: Source, new: Source, paths: Sequence[str], timeout_s: float) -> Iterator[tuple[Found, Found]]:
    """The definitions of both; a revision without a path means the folder of the other side, or the current one.

    Raises:
        SourceError: one is not there. DefinitionError: it has problems. Others as bags and nodes raise them.
    """
    folders = [one.text for one in (old, new) if one.kind == "folder"]
    with _opened(old, paths, folders, timeout_s) as one, _opened(new, paths, folders, timeout_s) as other:
        yield one, other


@contextmanager
def _opened(source: Source, paths: Sequence[str], folders: Sequence[str], timeout_s: float) -> Iterator[Found]:
    match source.kind:
        case "folder":
            yield _of_folder(source.text, paths)
        case "git":
            with revision.checked_out(source.text, folders[0] if folders else ".") as (folder, shown, notes):
                yield _of_revision(folder, shown, notes, paths)
        case "bag":
            yield _of_bag(source.text, paths)
        case _:
            from rosidl_py_gen.cli.robot import types_of_node

            facts, notes = types_of_node(source.text, timeout_s)
            yield Found(facts, None, notes)


def _of_folder(folder: str, paths: Sequence[str]) -> Found:
    search = search_path([folder, *paths])
    own = sorted(name for name, package in search.packages.items() if package.origin == folder)
    library, names = load(search, own) if own else (Library(search), [])
    facts = facts_of(library, [name for name in names if name.package in own])
    return Found(
        facts, search, [str(note) for note in notes_of(search, [name for name in names if name.package in own])]
    )


def _of_revision(folder: Path | None, shown: str, notes: list[str], paths: Sequence[str]) -> Found:
    """Places in errors are told as git does: ``main:src/my_msgs/msg/Wheel.msg:3:1``."""
    if folder is None:
        search = search_path([*paths])
        return Found(Facts(), search, notes)
    prefixes = sorted({str(folder), shown_path(folder)}, key=len, reverse=True)

    def told(problem: Problem) -> Problem:
        for prefix in prefixes:
            if problem.path.startswith(prefix):
                return Problem(shown + problem.path[len(prefix) :], *_rest(problem))
        return problem

    try:
        found = _of_folder(str(folder), paths)
    except DefinitionError as error:
        raise DefinitionError([*map(told, error.problems)], [*map(told, error.notes)]) from None
    for prefix in prefixes:
        found.notes = [note.replace(prefix, shown) for note in found.notes]
    return Found(_with_places(found.facts, prefixes, shown), found.search, [*notes, *found.notes])


def _rest(problem: Problem) -> tuple[int, int, str, str]:
    return problem.line, problem.column, problem.text, problem.source


def _with_places(facts: Facts, prefixes: Sequence[str], shown: str) -> Facts:
    def told(place: str) -> str:
        prefix = next((one for one in prefixes if place.startswith(one)), None)
        return place if prefix is None else shown + place[len(prefix) :]

    messages = {
        name: one._replace(
            fields=tuple(field._replace(place=told(field.place)) for field in one.fields),
            constants=one.constants and tuple(item._replace(place=told(item.place)) for item in one.constants),
        )
        for name, one in facts.messages.items()
    }
    return Facts(facts.interfaces, messages, facts.hashes)


def _of_bag(path: str, paths: Sequence[str]) -> Found:
    from rosidl_py_gen.bags import BagReader
    from rosidl_py_gen.types.by_name import library_of_text
    from rosidl_py_gen.types.from_description import definition_text

    parts: list[tuple[str, Facts]] = []
    notes: list[str] = []
    with BagReader(path, search_path=[*paths]) as bag:
        for channel in bag.channels:
            try:
                found = bag.definition(channel)
                text = channel.definition if found.origin == "the bag" else definition_text(found.cls)
                name = split_ros_name(channel.type_name, "msg")
                library = library_of_text(str(name), text)
            except RosidlError as error:
                notes.append(f"{path}: left out {channel.name} [{channel.type_name}]: {error}")
                continue
            if not found.is_certain:
                notes.append(f"{path}: {channel.type_name} is taken from {found.origin}, by its name alone")
            parts.append((channel.name, as_recorded(facts_with_needs(library, library.owner(name) or name))))
    try:
        return Found(joined(parts), None, notes)
    except RosidlError as error:
        advice = "`rosidl-py bag convert --topics` makes a bag of one of them"
        raise SourceError(f"{path}: {error}; {advice}") from None
