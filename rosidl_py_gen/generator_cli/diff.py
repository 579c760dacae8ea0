"""The command `diff`: compare two sets of definitions, report breaking changes, and print them as text or JSON.

A set comes from a folder, a git revision, a bag, a running node, or a ROS 2 distribution. The kind of a source is
stated by the prefix `folder:`, `git:`, `bag:`, `node:` or `distro:`. Without one, a source is an existing file or
folder, else a node if it starts with ``/``, else a revision. Folders, revisions and distributions are complete: a type
that they lack does not exist. Bags and nodes have only some definitions.

Nodes of ROS 2 describe the messages of topics, but services and actions only by their hash; types without a description
are skipped with a note. Descriptions are limited and checked like other definitions.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen import encode, to_dict
from rosidl_py_gen.base.descriptions import TypeDescriptions
from rosidl_py_gen.base.names import RosName, did_you_mean
from rosidl_py_gen.compiler.frontend import (
    InterfaceRegistry,
    SearchPath,
    registry_from_text,
)
from rosidl_py_gen.compiler.generate import LoadedInterfaces
from rosidl_py_gen.errors import DefinitionError, Diagnostic, RosidlError, TypeNotFoundError, display_path, printable
from rosidl_py_gen.generator_cli import git_revision
from rosidl_py_gen.generator_cli.command_line import echo, print_json, print_line, split_filter
from rosidl_py_gen.generator_cli.compare import (
    ChangeKind,
    DefinitionSet,
    as_recorded,
    collect,
    collect_with_dependencies,
    compare,
    merge,
    select_names,
)
from rosidl_py_gen.type_loading import CachedDescription, DescribedType

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.compiler.frontend import SearchPath
    from rosidl_py_gen.generator_cli.compare import Comparison, ElementChange, MessageChange, TypeChange
    from rosidl_py_gen.runtime import Node

KINDS = ("folder", "git", "bag", "node", "distro")
_BAG_FILES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_METADATA = "metadata.yaml"
_DISCOVERY_INTERVAL_S = 0.5
"""Time between two checks of a node's endpoints, in seconds. Two equal results mean that all endpoints have been
discovered."""
_ANSWER_TIMEOUT_S = 5.0
"""Maximum time for the reply of a node with the description of one type, in seconds."""
_HIDDEN = "/_action/"
_EVENTS = "/_service_event"


class SourceError(RosidlError):
    """Raised if a source to compare does not exist or cannot be read."""


class DiffSource(NamedTuple):
    """Source of definitions to compare: its kind (one of `KINDS`), and a path, revision, node or distribution name."""

    kind: str
    text: str

    @property
    def is_whole(self) -> bool:
        """True if the source contains every type that exists. False for a bag or node, which has only some types."""
        return self.kind in ("folder", "git", "distro")


@dataclass(slots=True)
class LoadedDefinitions:
    """Definitions of a source in `facts`, with the search path from which they were read, and notes for the user."""

    facts: DefinitionSet
    search: SearchPath | None = None
    notes: list[str] = field(default_factory=list)

    def with_types(self, names: Iterable[str]) -> LoadedDefinitions:
        """Return these definitions, completed by definitions of the types `names` as far as the search path
        has them.
        """
        if self.search is None:
            return self
        registry, parts = InterfaceRegistry(self.search), [("", self.facts)]
        for name in names:
            if name in self.facts.interfaces:
                continue
            try:
                owner = registry.read_checked(RosName.parse(name))
            except TypeNotFoundError:
                continue
            found = collect(registry, [owner])
            # Recordings of a derived message, such as X_Event, may lack the rest of X.
            interfaces = found.interfaces if str(owner) == name else {name: (name,)}
            parts.append(("", DefinitionSet(interfaces, found.messages, found.hashes)))
        return LoadedDefinitions(merge(parts), self.search, self.notes)


def parse_source(text: str) -> DiffSource:
    """Return the source of definitions that an argument of the command line names.

    Raises `SourceError` if it cannot be a source.
    """
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
    """Yield the definitions of two sources; temporary files of a git revision exist until the block ends.

    A revision without a path means the folder of the other source, or the current folder. Raises `SourceError` or
    `RevisionError` if a source cannot be read, and `DefinitionError` if definitions are invalid.
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
                    facts, notes = types_of_node(source.text, timeout_s)
                    return LoadedDefinitions(facts, None, notes)

        yield load_source(old), load_source(new)


def _from_folder(folder: str, paths: Sequence[str]) -> LoadedDefinitions:
    search = SearchPath.scan([folder, *paths])
    own = sorted(name for name, package in search.packages.items() if package.origin == folder)
    registry, names = LoadedInterfaces.load(search, own) if own else (InterfaceRegistry(search), [])
    names = [name for name in names if name.package in own]
    return LoadedDefinitions(collect(registry, names), search, [*map(str, search.notes(names))])


def _from_distribution(distro: str) -> LoadedDefinitions:
    registry, names = LoadedInterfaces.of_distribution(distro)
    return LoadedDefinitions(collect(registry, names), registry.search)


def _from_revision(folder: Path | None, display: str, notes: list[str], paths: Sequence[str]) -> LoadedDefinitions:
    """Return the definitions of a git revision in `folder`, with locations as ``main:src/my_msgs/msg/Wheel.msg:3``."""
    if folder is None:
        search = SearchPath.scan([*paths])
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
        name: one._replace(source=one.source._replace(path=in_revision(one.source.path)))
        for name, one in loaded.facts.messages.items()
    }
    return LoadedDefinitions(
        replace(loaded.facts, messages=messages), loaded.search, [*notes, *map(in_revision, loaded.notes)]
    )


def _from_bag(path: str, paths: Sequence[str]) -> LoadedDefinitions:
    from rosidl_py_gen.bags import BagReader
    from rosidl_py_gen.type_loading import definition_text

    parts: list[tuple[str, DefinitionSet]] = []
    notes: list[str] = []
    search: SearchPath | None = None
    with BagReader(path, search_path=[*paths]) as bag:
        for channel in bag.channels:
            try:
                found = bag.definition(channel)
                text = channel.definition if found.origin == "the bag" else definition_text(found.message_class)
                name = RosName.parse(channel.type_name, "msg")
                search = search or SearchPath.scan()  # for types that the text of a bag lacks
                registry = registry_from_text(name, text, search)
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


def types_of_node(name: str, timeout_s: float) -> tuple[DefinitionSet, list[str]]:
    """Return the definitions of the types that a running node uses, and notes about skipped types.

    Raises `SourceError` if the node is not found in time or describes no type, and KeyboardInterrupt after a signal.
    """
    from rosidl_py_gen.runtime import Node, run

    async def request() -> tuple[DefinitionSet, list[str]]:
        options: dict[str, Any] = {"enable_rosout": False, "start_services": False, "parameter_events": False}
        async with Node(f"_rosidl_py_gen_{os.getpid()}", **options) as node:
            return await definitions_of_node(node, name, timeout_s)

    result = run(request())
    if result is None:  # a signal
        raise KeyboardInterrupt
    return result


async def definitions_of_node(node: Node, robot: str, timeout_s: float) -> tuple[DefinitionSet, list[str]]:
    """Return the definitions of the types that the node `robot` uses, and notes.

    The local node `node` sends the requests.
    """
    import asyncio

    from rosidl_py_gen.runtime import WaitTimeoutError

    try:
        await node.wait_for_node(robot, timeout_s)
    except WaitTimeoutError as error:
        raise SourceError(str(error)) from None
    before = None
    while (now := _used_types(node, robot)) != before:
        before = now
        await asyncio.sleep(_DISCOVERY_INTERVAL_S)
    return await _request_types(node, robot, now)


def _used_types(node: Node, full_name: str) -> dict[str, dict[str, str]]:
    """Return the types that a node uses, by kind (msg, srv, action), with a topic, service or action of each type."""
    namespace, _, name = full_name.rpartition("/")
    namespace = namespace or "/"
    found: dict[str, dict[str, str]] = {"msg": {}, "srv": {}, "action": {}}
    topics = [
        *node.get_publisher_names_and_types_by_node(name, namespace),
        *node.get_subscriber_names_and_types_by_node(name, namespace),
    ]
    services = [
        *node.get_service_names_and_types_by_node(name, namespace),
        *node.get_client_names_and_types_by_node(name, namespace),
    ]
    for kind, entries in (("msg", topics), ("srv", services)):
        for entry, types in entries:
            action, hidden, _ = entry.partition(_HIDDEN)
            for one in types:
                if not hidden and not entry.endswith(_EVENTS):
                    found[kind].setdefault(one, entry)
                elif hidden and "/action/" in one:  # A_SendGoal, A_GetResult or A_FeedbackMessage
                    found["action"].setdefault(one.rpartition("_")[0], action)
    return found


async def _request_types(node: Node, robot: str, used: dict[str, dict[str, str]]) -> tuple[DefinitionSet, list[str]]:
    import asyncio

    parts: list[tuple[str, DefinitionSet]] = []
    notes: list[str] = []
    for kind, entries in used.items():
        for type_name, entry in sorted(entries.items()):
            try:
                if kind == "msg":
                    answer = await node.get_type_description(robot, type_name, timeout_s=_ANSWER_TIMEOUT_S)
                    facts = await asyncio.to_thread(_from_description, type_name, answer)
                else:
                    resolve = node.resolve_service_type if kind == "srv" else node.resolve_action_type
                    cls: type[Any] = await resolve(entry, type_name, timeout_s=_ANSWER_TIMEOUT_S)
                    facts = await asyncio.to_thread(_from_class, type_name, cls)
            except RosidlError as error:
                notes.append(f"{robot}: skipped {type_name} of {entry}: {error}")
                continue
            parts.append((f"{entry} of {robot}", facts))
    if notes and not parts:
        raise SourceError(f"{robot} describes none of its types: {notes[0]}")
    if used["srv"] or used["action"]:
        notes.append(
            f"{robot}: constants of services and actions are unknown, and defaults may come from this installation"
        )
    return merge(parts), notes


def _from_description(type_name: str, answer: Any) -> DefinitionSet:
    """Return the definitions that another node has sent.

    Raises `SourceError` if they are of another type or too large.
    """
    if len(encode(answer)) > CachedDescription.MAX_BYTES:
        raise SourceError(f"its description has more than {CachedDescription.MAX_BYTES} bytes")
    description = to_dict(answer.type_description)
    name = RosName.parse(type_name)
    if (other := description["type_description"]["type_name"]) != type_name:
        raise SourceError(f"the answer describes another type: {other[:100]}")
    sources = {one.type_name: (one.encoding, one.raw_file_contents) for one in answer.type_sources}
    registry = DescribedType(type_name, TypeDescriptions.by_name(description), sources).registry()
    if registry.type_hash(type_name) != TypeDescriptions.rihs01(description):
        raise SourceError("the answer describes types that do not belong to it")
    return collect_with_dependencies(registry, registry.owner(name) or name)


def _from_class(type_name: str, cls: type[Any]) -> DefinitionSet:
    return collect_with_dependencies(DescribedType.of_class(cls).registry(), RosName.parse(type_name))


_DEFAULT = ("data", "code")
_SIGNS = {"added": "+", "removed": "-"}
_COLOURS = {"+": "green", "-": "red", "~": "yellow"}


def diff(
    old: str, new: str, paths: tuple[str, ...], selection: str, fail_on: Sequence[str], timeout_s: float, as_json: bool
) -> int:
    """Compare two sources and print the changes; return 1 if a change is of a kind in `fail_on` (empty: default)."""
    old_source, new_source = parse_source(old), parse_source(new)
    with load_sources(old_source, new_source, paths, timeout_s) as (before, after):
        # A bag or node may use types that are defined outside of the folders with which it is compared.
        if not old_source.is_whole:
            after = after.with_types(before.facts.interfaces)
        if not new_source.is_whole:
            before = before.with_types(after.facts.interfaces)
        comparison = compare(
            before.facts, after.facts, old_is_whole=old_source.is_whole, new_is_whole=new_source.is_whole
        )
    if wanted := split_filter(selection):
        known = {*before.facts.interfaces, *after.facts.interfaces}
        names = [str(RosName.parse(name, "msg")) if "/" in name else name for name in wanted]
        for name in names:
            if name not in known and all(name != type_name.partition("/")[0] for type_name in known):
                raise SourceError(f"--filter {name}: neither {old} nor {new} has it{did_you_mean(name, known)}")
        comparison = select_names(comparison, names)
    breaking = sorted(one.value for one in comparison.consequences() & _failing(fail_on or _DEFAULT))
    notes = [*before.notes, *after.notes]
    if as_json:
        print_json(_document(old, new, comparison, breaking, notes))
    else:
        for note in notes:
            print_line(f"note: {printable(note)}", "yellow")
        _show(comparison, breaking)
    return 1 if breaking else 0


def _failing(chosen: Sequence[str]) -> frozenset[ChangeKind]:
    if "nothing" in chosen:
        return frozenset()
    return frozenset(ChangeKind if "any" in chosen else map(ChangeKind, chosen))


def _show(found: Comparison, breaking: Sequence[str]) -> None:
    for name in found.removed:
        _line(f"- {name}", "red")
    for name in found.added:
        _line(f"+ {name}", "green")
    for one in found.changed:
        _line(f"~ {one.name}", "yellow")
        for text, colour in _details(one):
            _line(f"    {text}", colour)
    if found.not_compared:
        names = ", ".join(found.not_compared)
        _line(f"not compared, as only one side has them: {names}")
    counts = (
        f"{len(found.changed)} changed, {len(found.added)} added, {len(found.removed)} removed, "
        f"{len(found.same)} unchanged"
    )
    consequences = ", ".join(sorted(one.value for one in found.consequences()))
    parts = [counts, *([f"changes of {consequences}"] if consequences else [])]
    _line("; ".join([*parts, f"breaking: {', '.join(breaking)}" if breaking else "not breaking"]))


def _line(text: str, colour: str = "") -> None:
    echo((printable(text), colour))


def _details(change: TypeChange) -> Iterator[tuple[str, str]]:
    is_one = [one.name for one in change.messages] == [change.name]
    if not is_one:
        yield from _hashes(change)
    for message in change.messages:
        indent = "" if is_one else "  "
        if not is_one:
            yield message.name.removeprefix(f"{change.name}_"), "yellow"
        for text, colour in _message_lines(message):
            yield indent + text, colour
    if change.used_by:
        yield f"changes with it: {', '.join(change.used_by)}", ""


def _hashes(change: TypeChange | MessageChange) -> Iterator[tuple[str, str]]:
    if change.old_hash == change.new_hash:
        yield f"hash      {change.old_hash}, as before", ""
    else:
        yield f"hash      {change.old_hash}", ""
        yield f"       -> {change.new_hash}", ""


def _message_lines(change: MessageChange) -> Iterator[tuple[str, str]]:
    yield from _hashes(change)
    for kind, changes in (("field   ", change.fields), ("constant", change.constants)):
        for one in changes:
            sign, text = _sign_and_text(one)
            yield f"{kind}  {sign} {text}{f'  ({one.place})' if one.place else ''}", _COLOURS[sign]
    if change.through:
        yield f"contains  ~ {', '.join(change.through)}", ""
    yield ("old data  read as before", "") if change.reads_old_data else ("old data  not read as before", "red")


def _sign_and_text(one: ElementChange) -> tuple[str, str]:
    match one.what:
        case "added" | "removed":
            return _SIGNS[one.what], f"{one.name}: {one.after or one.before}"
        case "renamed":
            return "~", f"{one.after}: was {one.before}, probably"
        case "moved":
            return "~", f"{one.name}: moved from place {one.before} to {one.after}"
        case "type" | "changed":
            return "~", f"{one.name}: {one.before} -> {one.after}"
        case _:
            return "~", f"{one.name}: {one.what} {one.before or 'none'} -> {one.after or 'none'}"


def _document(old: str, new: str, found: Comparison, breaking: Sequence[str], notes: Sequence[str]) -> dict[str, Any]:
    return {
        "old": old,
        "new": new,
        "added": list(found.added),
        "removed": list(found.removed),
        "changed": [
            {
                "name": one.name,
                "old_hash": one.old_hash,
                "new_hash": one.new_hash,
                "sorts": sorted(consequence.value for consequence in one.consequences()),
                "used_by": list(one.used_by),
                "messages": [_message(message) for message in one.messages],
            }
            for one in found.changed
        ],
        "not_compared": list(found.not_compared),
        "unchanged": len(found.same),
        "sorts": sorted(consequence.value for consequence in found.consequences()),
        "breaking": list(breaking),
        "notes": list(notes),
    }


def _message(change: MessageChange) -> dict[str, Any]:
    return {
        "name": change.name,
        "old_hash": change.old_hash,
        "new_hash": change.new_hash,
        "fields": [_entry(one) for one in change.fields],
        "constants": [_entry(one) for one in change.constants],
        "contains": list(change.through),
        "reads_old_data": change.reads_old_data,
    }


def _entry(one: ElementChange) -> dict[str, Any]:
    entry = one._asdict()
    entry["sort"] = entry.pop("consequence").value
    return entry
