"""Sources of definitions for `diff`: a folder, a git revision, a bag, a running node, or a ROS 2 distribution.

The kind of a source is stated by the prefix `folder:`, `git:`, `bag:`, `node:` or `distro:`. Without one, a source is
an existing file or folder, else a node if it starts with ``/``, else a revision. Folders, revisions and distributions
are complete: a type that they lack does not exist. Bags and nodes have only some definitions.
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.distributions import selected
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.compatibility.definition_set import (
    DefinitionSet,
    as_recorded,
    collect,
    collect_with_dependencies,
    merge,
)
from rosidl_py_gen.compiler.frontend.bundled import is_absent
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, read_checked
from rosidl_py_gen.compiler.frontend.search_path import BUNDLED, scan_search_path
from rosidl_py_gen.compiler.generate import load, notes_of
from rosidl_py_gen.errors import DefinitionError, Diagnostic, RosidlError, TypeNotFoundError, display_path
from rosidl_py_gen.generator_cli import git_revision

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

KINDS = ("folder", "git", "bag", "node", "distro")
_BAG_FILES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_METADATA = "metadata.yaml"


class SourceError(RosidlError):
    """A source to compare does not exist or cannot be read."""


class DiffSource(NamedTuple):
    """A source to compare: one of `KINDS`, and a path, revision or node name."""

    kind: str
    text: str

    @property
    def is_whole(self) -> bool:
        """True if a type that the source lacks does not exist."""
        return self.kind in ("folder", "git", "distro")


@dataclass(slots=True)
class LoadedDefinitions:
    """Definitions of a source, with notes for the user."""

    facts: DefinitionSet
    search: SearchPath | None = None
    notes: list[str] = field(default_factory=list)

    def with_types(self, names: Iterable[str]) -> LoadedDefinitions:
        """Return the definitions with more types of the search path, as far as it has them.

        Raises:
            DefinitionError: one of these types has problems.
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
            # Recordings of a derived message, such as X_Event, may lack the rest of X.
            interfaces = found.interfaces if str(owner) == name else {name: (name,)}
            parts.append(("", DefinitionSet(interfaces, found.messages, found.hashes)))
        return LoadedDefinitions(merge(parts), self.search, self.notes)


def parse_source(text: str) -> DiffSource:
    """Return the source that a text names; raises `SourceError` if there is none."""
    kind, colon, rest = text.partition(":")
    if colon and kind in KINDS:
        if not rest:
            raise SourceError(f'"{text}": expected a source after {kind}:')
        return DiffSource(kind, rest)
    path = Path(text)
    if path.is_dir():
        return DiffSource("bag" if _is_bag(path) else "folder", text)
    if path.exists():
        if text.endswith(_BAG_FILES):
            return DiffSource("bag", text)
        raise SourceError(f"{text}: a file that is not a bag; expected a folder of packages, {', '.join(_BAG_FILES)}")
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
def load_sources(
    old: DiffSource, new: DiffSource, paths: Sequence[str], timeout_s: float
) -> Iterator[tuple[LoadedDefinitions, LoadedDefinitions]]:
    """Load the definitions of two sources; files of a revision exist inside the block.

    A revision without a path means the folder of the other source, or the current folder.

    Raises:
        SourceError: a source does not exist.
        DefinitionError: definitions have problems.
    """
    folder = next((source.text for source in (old, new) if source.kind == "folder"), ".")
    with ExitStack() as stack:

        def load_source(source: DiffSource) -> LoadedDefinitions:
            match source.kind:
                case "folder":
                    return _from_folder(source.text, paths)
                case "git":
                    revision = stack.enter_context(git_revision.checked_out(source.text, folder))
                    return _from_revision(*revision, paths)
                case "bag":
                    return _from_bag(source.text, paths)
                case "distro":
                    return _from_distribution(source.text)
                case _:
                    from rosidl_py_gen.generator_cli.node_definitions import types_of_node

                    facts, notes = types_of_node(source.text, timeout_s)
                    return LoadedDefinitions(facts, None, notes)

        yield load_source(old), load_source(new)


def _from_folder(folder: str, paths: Sequence[str]) -> LoadedDefinitions:
    search = scan_search_path([folder, *paths])
    own = sorted(name for name, package in search.packages.items() if package.origin == folder)
    registry, names = load(search, own) if own else (InterfaceRegistry(search), [])
    names = [name for name in names if name.package in own]
    return LoadedDefinitions(collect(registry, names), search, [*map(str, notes_of(search, names))])


def _from_distribution(distro: str) -> LoadedDefinitions:
    search = scan_search_path(ament="", distro=distro)
    registry, names = load(search, [name for name, one in search.packages.items() if one.origin == BUNDLED])
    names = [name for name in names if not is_absent(name, selected(distro).name)]
    return LoadedDefinitions(collect(registry, names), search)


def _from_revision(folder: Path | None, display: str, notes: list[str], paths: Sequence[str]) -> LoadedDefinitions:
    """Return the definitions with locations as in git: ``main:src/my_msgs/msg/Wheel.msg:3:1``."""
    if folder is None:
        search = scan_search_path([*paths])
        return LoadedDefinitions(DefinitionSet(), search, notes)
    prefixes = sorted({str(folder), display_path(folder)}, key=len, reverse=True)

    def in_revision(place: str) -> str:
        prefix = next((one for one in prefixes if place.startswith(one)), None)
        return place if prefix is None else display + place[len(prefix) :]

    def diagnostics_in_revision(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
        return [replace(one, path=in_revision(one.path)) for one in diagnostics]

    try:
        loaded = _from_folder(str(folder), paths)
    except DefinitionError as error:
        raise DefinitionError(
            diagnostics_in_revision(error.diagnostics), diagnostics_in_revision(error.notes)
        ) from None
    messages = {
        name: one._replace(
            fields=tuple(field._replace(place=in_revision(field.place)) for field in one.fields),
            constants=one.constants and tuple(item._replace(place=in_revision(item.place)) for item in one.constants),
        )
        for name, one in loaded.facts.messages.items()
    }
    return LoadedDefinitions(
        replace(loaded.facts, messages=messages), loaded.search, [*notes, *map(in_revision, loaded.notes)]
    )


def _from_bag(path: str, paths: Sequence[str]) -> LoadedDefinitions:
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
                notes.append(f"{path}: skipped {channel.name} [{channel.type_name}]: {error}")
                continue
            if not found.is_recorded:
                notes.append(f"{path}: {channel.type_name} is defined by {found.origin}, selected only by its name")
            parts.append((channel.name, as_recorded(collect_with_dependencies(registry, registry.owner(name) or name))))
    try:
        return LoadedDefinitions(merge(parts), None, notes)
    except RosidlError as error:
        advice = "`rosidl-py bag convert --topics` makes a bag of one of them"
        raise SourceError(f"{path}: {error}; {advice}") from None
