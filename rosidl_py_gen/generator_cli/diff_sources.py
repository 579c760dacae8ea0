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
from rosidl_py_gen.compiler.compatibility.definition_set import (
    DefinitionSet,
    as_recorded,
    collect,
    collect_with_dependencies,
    merge,
)
from rosidl_py_gen.compiler.frontend.definition_text import read_checked
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.compiler.generate import load, notes_of
from rosidl_py_gen.errors import DefinitionError, Diagnostic, RosidlError, TypeNotFoundError, display_path
from rosidl_py_gen.generator_cli import git_revision

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

KINDS = ("folder", "git", "bag", "node")
_BAG_FILES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_METADATA = "metadata.yaml"


class SourceError(RosidlError):
    """What was given to compare is not there, or cannot be read; the text says why."""


class DiffSource(NamedTuple):
    """What is compared: one of `KINDS`, and a path, revision or node name."""

    kind: str
    text: str

    @property
    def is_whole(self) -> bool:
        """Whether a type that it does not have does not exist."""
        return self.kind in ("folder", "git")


@dataclass(slots=True)
class LoadedDefinitions:
    """The definitions of a source, with what has to be said of them."""

    facts: DefinitionSet
    search: SearchPath | None = None
    notes: list[str] = field(default_factory=list)

    def with_types(self, names: Iterable[str]) -> LoadedDefinitions:
        """Those of the names that the search path has beside its own: a bag may use any of them.

        Raises:
            DefinitionError: one of them has problems.
        """
        if self.search is None:
            return self
        registry, parts = InterfaceRegistry(self.search), [("", self.facts)]
        for name in names:
            if name in self.facts.interfaces:
                continue
            try:
                owner = read_checked(registry, split_ros_name(name))
            except TypeNotFoundError:
                continue
            found = collect(registry, [owner])
            # Recordings of X_Event and the like may have no more than this message of X.
            interfaces = found.interfaces if str(owner) == name else {name: (name,)}
            parts.append(("", DefinitionSet(interfaces, found.messages, found.hashes)))
        return LoadedDefinitions(merge(parts), self.search, self.notes)


def parse_source(text: str) -> DiffSource:
    """What a text stands for.

    Raises:
        SourceError: nothing.
    """
    kind, colon, rest = text.partition(":")
    if colon and kind in KINDS:
        if not rest:
            raise SourceError(f'"{text}": expected something behind {kind}:')
        return DiffSource(kind, rest)
    path = Path(text)
    if path.is_dir():
        return DiffSource("bag" if _is_bag(path) else "folder", text)
    if path.exists():
        if text.endswith(_BAG_FILES):
            return DiffSource("bag", text)
        raise SourceError(f"{text}: a file that is no bag; expected a folder of packages, {', '.join(_BAG_FILES)}")
    if text.startswith("/"):
        return DiffSource("node", text)
    if text.endswith(_BAG_FILES) or text.startswith((".", "~")):
        raise SourceError(f"{text}: there is no such file or folder")
    return DiffSource("git", text)


def _is_bag(folder: Path) -> bool:
    if (folder / "package.xml").is_file():
        return False
    return (folder / _METADATA).is_file() or any(one.name.endswith(_BAG_FILES) for one in folder.iterdir())


@contextmanager
def opened(
    old: DiffSource, new: DiffSource, paths: Sequence[str], timeout_s: float
) -> Iterator[tuple[LoadedDefinitions, LoadedDefinitions]]:
    """The definitions of both; a revision without a path means the folder of the other side, or the current one.

    Raises:
        SourceError: one is not there. DefinitionError: it has problems. Others as bags and nodes raise them.
    """
    folders = [one.text for one in (old, new) if one.kind == "folder"]
    with _opened(old, paths, folders, timeout_s) as one, _opened(new, paths, folders, timeout_s) as other:
        yield one, other


@contextmanager
def _opened(
    source: DiffSource, paths: Sequence[str], folders: Sequence[str], timeout_s: float
) -> Iterator[LoadedDefinitions]:
    match source.kind:
        case "folder":
            yield _of_folder(source.text, paths)
        case "git":
            with git_revision.checked_out(source.text, folders[0] if folders else ".") as (folder, shown, notes):
                yield _of_revision(folder, shown, notes, paths)
        case "bag":
            yield _of_bag(source.text, paths)
        case _:
            from rosidl_py_gen.generator_cli.node_definitions import types_of_node

            facts, notes = types_of_node(source.text, timeout_s)
            yield LoadedDefinitions(facts, None, notes)


def _of_folder(folder: str, paths: Sequence[str]) -> LoadedDefinitions:
    search = scan_search_path([folder, *paths])
    own = sorted(name for name, package in search.packages.items() if package.origin == folder)
    registry, names = load(search, own) if own else (InterfaceRegistry(search), [])
    facts = collect(registry, [name for name in names if name.package in own])
    return LoadedDefinitions(
        facts, search, [str(note) for note in notes_of(search, [name for name in names if name.package in own])]
    )


def _of_revision(folder: Path | None, shown: str, notes: list[str], paths: Sequence[str]) -> LoadedDefinitions:
    """Places in errors are told as git does: ``main:src/my_msgs/msg/Wheel.msg:3:1``."""
    if folder is None:
        search = scan_search_path([*paths])
        return LoadedDefinitions(DefinitionSet(), search, notes)
    prefixes = sorted({str(folder), display_path(folder)}, key=len, reverse=True)

    def told(problem: Diagnostic) -> Diagnostic:
        for prefix in prefixes:
            if problem.path.startswith(prefix):
                return Diagnostic(shown + problem.path[len(prefix) :], *_rest(problem))
        return problem

    try:
        found = _of_folder(str(folder), paths)
    except DefinitionError as error:
        raise DefinitionError([*map(told, error.diagnostics)], [*map(told, error.notes)]) from None
    for prefix in prefixes:
        found.notes = [note.replace(prefix, shown) for note in found.notes]
    return LoadedDefinitions(_with_places(found.facts, prefixes, shown), found.search, [*notes, *found.notes])


def _rest(problem: Diagnostic) -> tuple[int, int, str, str]:
    return problem.line, problem.column, problem.text, problem.source


def _with_places(facts: DefinitionSet, prefixes: Sequence[str], shown: str) -> DefinitionSet:
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
    return DefinitionSet(facts.interfaces, messages, facts.hashes)


def _of_bag(path: str, paths: Sequence[str]) -> LoadedDefinitions:
    from rosidl_py_gen.bags import BagReader
    from rosidl_py_gen.type_loading.class_lookup import registry_of_text
    from rosidl_py_gen.type_loading.from_description import definition_text

    parts: list[tuple[str, DefinitionSet]] = []
    notes: list[str] = []
    with BagReader(path, search_path=[*paths]) as bag:
        for channel in bag.channels:
            try:
                found = bag.definition(channel)
                text = channel.definition if found.origin == "the bag" else definition_text(found.message_class)
                name = split_ros_name(channel.type_name, "msg")
                registry = registry_of_text(str(name), text)
            except RosidlError as error:
                notes.append(f"{path}: left out {channel.name} [{channel.type_name}]: {error}")
                continue
            if not found.is_recorded:
                notes.append(f"{path}: {channel.type_name} is taken from {found.origin}, by its name alone")
            parts.append((channel.name, as_recorded(collect_with_dependencies(registry, registry.owner(name) or name))))
    try:
        return LoadedDefinitions(merge(parts), None, notes)
    except RosidlError as error:
        advice = "`rosidl-py bag convert --topics` makes a bag of one of them"
        raise SourceError(f"{path}: {error}; {advice}") from None
