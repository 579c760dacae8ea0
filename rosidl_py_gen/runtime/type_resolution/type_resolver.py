"""From what nodes announce to a class: a local one of the same hash, or a definition that one of these nodes gives.

Decides the order (local, kept on disk, asked for), who is asked and for how long, and what is refused. Nothing that a
node says of a type is used before its hash is the announced one. Whatever takes long runs in a thread.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import rihs01
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr import Action, Message, Service
from rosidl_py_gen.cdr.typesupport import hashes_of, type_hash
from rosidl_py_gen.errors import (
    ClosedError,
    DefinitionError,
    InvalidNameError,
    RosidlError,
    TypeNotFoundError,
    printable,
)
from rosidl_py_gen.runtime.entities.service_common import CallTimeoutError
from rosidl_py_gen.runtime.time.deadline import Deadline
from rosidl_py_gen.runtime.transport.discovery_events import TopicKey
from rosidl_py_gen.runtime.type_resolution.announcements import (
    TYPE_HASH,
    announced,
    is_complete,
    join_truncated,
    provider_participants,
)
from rosidl_py_gen.runtime.type_resolution.description_client import (
    SERVICE,
    TypeDescriptionError,
    decode_description,
    request_type_description,
)
from rosidl_py_gen.type_loading.description_cache import MAX_BYTES, load_description, store_description

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from rosidl_py_gen.base.descriptions import Description
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.type_resolution.announcements import TypeAnnouncement, TypeQuery
    from rosidl_py_gen.type_loading.class_lookup import HashPredicate, SearchFolders

_ANSWER_TIMEOUT_S = 3.0
"""How long a node may take to answer, where others could be asked."""
_SERVICE_TIMEOUT_S = 1.0
"""The same for a node whose service is not known: it may have none."""
_NODE_NAME_TIMEOUT_S = 4.0
"""With Fast DDS the names of nodes may follow by 3 s (docs/internals/protocol.md 6)."""
_LATE_ANNOUNCEMENT_S = 2.0
"""What a node announces last may follow by this much: Fast DDS repeats lost announcements after 1 s."""
_MAX_ASKED = 8
_KINDS = {Message: "a message", Service: "a service", Action: "an action"}
_WHAT_TO_DO = "install its package, or add it to the search path (`path=`, `--path`, AMENT_PREFIX_PATH)"


@dataclass(frozen=True, slots=True)
class ResolveRequest:
    """What is asked for; `base` is what the class has to be."""

    subject: TypeQuery
    base: type[Any]
    type_name: str | None
    type_hash: str | None
    path: SearchFolders


@dataclass(slots=True)
class _FetchedDescriptions:
    """What nodes said, by type name; every answer had the hash that was announced."""

    who: dict[str, None] = field(default_factory=dict)
    individuals: dict[str, Description] = field(default_factory=dict)
    sources: dict[str, tuple[str, str]] = field(default_factory=dict)


async def resolve(scope: EntityScope, names: NodeNames, request: ResolveRequest, timeout_s: float | None) -> Any:
    """The class of a topic, service or action; see `Node.resolve_type`."""
    if request.type_name is not None:
        split_ros_name(request.type_name)
    if request.type_hash is not None and not TYPE_HASH.match(request.type_hash):
        raise TypeDescriptionError(
            f"expected a hash like RIHS01_ and 64 hexadecimal digits, got {request.type_hash!r:.100}"
        )
    cls = await _TypeResolver(scope, names, request, Deadline(timeout_s)).run(timeout_s)
    if not issubclass(cls, request.base):
        raise TypeDescriptionError(
            f"{_named(request)} has the type {cls._TYPE.name}, which is not {_KINDS[request.base]}"
        )
    return cls


def _named(request: ResolveRequest) -> str:
    return f"the {request.subject.kind} {request.subject.name}"


class _TypeResolver:
    """One request under way."""

    def __init__(self, scope: EntityScope, names: NodeNames, request: ResolveRequest, deadline: Deadline) -> None:
        self._scope = scope
        self._names = names
        self._request = request
        self._subject = request.subject
        self._deadline = deadline
        self._learned = _FetchedDescriptions()

    async def run(self, timeout_s: float | None) -> type[Any]:
        one = await self._announced(timeout_s)
        if not one.has_hashes():
            return await self._by_name(one)
        cls = await self._local(one, self._fits(one))
        if cls is not None:
            return cls
        try:
            return await self._fetch_with_late_announcements(one, timeout_s)
        except TypeDescriptionError as error:
            other = await self._local(one, lambda hashes: True)
            if other is None:
                raise
            raise TypeDescriptionError(f"{error}; the definition here has another hash, {type_hash(other)}") from error

    # ------------------------------------------------------------------------------------------------ announcements

    def _all(self, only: Collection[bytes] = ()) -> dict[str, TypeAnnouncement]:
        return announced(self._scope.graph, self._subject, only)

    def _candidates(self, only: Collection[bytes] = ()) -> list[TypeAnnouncement]:
        """The types of which everything is announced that is needed, the wanted one only if one is."""
        found = self._all(only)
        wanted = self._request.type_name
        return [one for one in found.values() if is_complete(one, self._subject) and wanted in (None, one.type_name)]

    async def _announced(self, timeout_s: float | None) -> TypeAnnouncement:
        scope = self._scope
        scope.discovery.refresh()
        if not await scope.wait_until(lambda: bool(self._candidates()), timeout_s, lambda: scope.closed):
            raise CallTimeoutError(self._nobody(timeout_s))
        found = self._candidates()
        if len(found) > 1 or (self._request.type_hash is None and found[0].is_ambiguous()):
            # Whoever asks wants to understand, or to be understood by, those who publish or serve.
            graph, own = scope.graph, {scope.participant.guid}
            there = {*provider_participants(graph, self._subject)}
            found = self._candidates(there - own or there) or found
        if len(found) > 1:
            raise self._several("types", found, "type_name")
        if self._request.type_hash is None and found[0].is_ambiguous():
            raise self._several("definitions", found, "type_hash")
        try:
            split_ros_name(found[0].type_name)
        except InvalidNameError:
            told = join_truncated(found[0].lines())
            raise TypeDescriptionError(f"the type of {_named(self._request)} is none of ROS: {told}") from None
        return found[0]

    def _nobody(self, timeout_s: float | None) -> str:
        found = [line for one in self._all().values() for line in one.lines()]
        wanted = f"the type {self._request.type_name}" if self._request.type_name else "a type"
        there = f"; there is {join_truncated(found)}" if found else ""
        return f"nobody announced {wanted} for {_named(self._request)} in {timeout_s} s{there}"

    def _several(self, what: str, found: list[TypeAnnouncement], by: str) -> TypeDescriptionError:
        lines = [line for one in sorted(found, key=lambda one: one.type_name) for line in one.lines()]
        return TypeDescriptionError(
            f"{_named(self._request)} has several {what}: {join_truncated(lines)}; say which by {by}"
        )

    def _fits(self, one: TypeAnnouncement) -> HashPredicate:
        """Whether hashes, by name, are those that are announced."""
        wanted = self._request.type_hash

        def fits(hashes: Mapping[str, str]) -> bool:
            told = {name: {text for text in by_hash if text} for name, by_hash in one.hashes.items()}
            is_told = all(hashes.get(name) in texts for name, texts in told.items() if texts)
            return is_told and wanted in (None, hashes.get(one.type_name))

        return fits

    # -------------------------------------------------------------------------------------------------- local ones

    async def _local(self, one: TypeAnnouncement, fits: HashPredicate) -> type[Any] | None:
        from rosidl_py_gen.type_loading.class_lookup import find_class

        return await asyncio.to_thread(find_class, one.type_name, fits, path=self._request.path)

    async def _by_name(self, one: TypeAnnouncement) -> type[Any]:
        """What to take where nobody tells a hash."""
        who = f"the nodes of {_named(self._request)} announce no hash for {one.type_name}, as those of ROS 2 Humble do"
        cls = await self._local(one, self._fits(one))
        if cls is None:
            what = (
                "and no local definition has the hash" if self._request.type_hash else "and there is no definition here"
            )
            raise TypeNotFoundError(f"{who}, {what}; {_WHAT_TO_DO}")
        self._scope.logger.warning(f"{who}; the local definition is used, whether or not it is theirs")
        return cls

    # ------------------------------------------------------------------------------------------------- fetched ones

    async def _fetch_with_late_announcements(self, one: TypeAnnouncement, timeout_s: float | None) -> type[Any]:
        """Try once more when what could help was announced a moment later: the events of a service, for example."""
        try:
            return await self._fetched(one)
        except TypeDescriptionError:
            scope, before = self._scope, len(one.hashes)

            def more() -> bool:
                later = self._all().get(one.type_name)
                return later is not None and len(later.hashes) > before

            patience_s = self._deadline.remaining_s(_LATE_ANNOUNCEMENT_S) if self._misses_extra(one) else 0.0
            if not await scope.wait_until(more, patience_s, lambda: scope.closed):
                raise
            return await self._fetched(await self._announced(timeout_s))

    def _misses_extra(self, one: TypeAnnouncement) -> bool:
        return any(one.type_name + part not in one.hashes for part in self._subject.extra.values())

    async def _fetched(self, one: TypeAnnouncement) -> type[Any]:
        from rosidl_py_gen.type_loading.from_description import compile_described, described_hashes

        name, is_service = one.type_name, self._subject.kind == "service"
        whole = self._request.type_hash
        if whole is not None:
            await self._fetch(name, whole, self._announcing_nodes(one, whole))
        else:
            await self._fetch_messages(one)
        learned = self._learned
        try:
            if name not in learned.individuals:
                hashes = await asyncio.to_thread(described_hashes, name, learned.individuals, is_service=is_service)
                self._require_fit(one, hashes)
                await self._fetch_sources(name, hashes[name], one.nodes())
            cls = await asyncio.to_thread(
                compile_described,
                name,
                learned.individuals,
                learned.sources,
                is_service=is_service,
                path=self._request.path,
            )
        except DefinitionError as error:
            raise TypeDescriptionError(
                f"what {join_truncated(learned.who)} said of {name} cannot be used: {error}"
            ) from error
        self._require_fit(one, hashes_of(cls))
        return cls

    def _require_fit(self, one: TypeAnnouncement, hashes: Mapping[str, str]) -> None:
        """Each message alone was what was announced; together they may be of several definitions."""
        if not self._fits(one)(hashes):
            raise self._several("definitions", [one], "type_hash")

    async def _fetch_messages(self, one: TypeAnnouncement) -> None:
        """All parts of the type, each from one of the messages that contain it."""
        for part, carriers in self._subject.messages.items():
            failures: list[str] = []
            for carrier in carriers:
                if one.type_name + part in self._learned.individuals:
                    break
                for wanted in one.of(carrier):
                    try:
                        await self._fetch(one.type_name + carrier, wanted, self._announcing_nodes(one, wanted))
                    except TypeDescriptionError as error:
                        failures.append(str(error))
            if one.type_name + part not in self._learned.individuals:
                raise TypeDescriptionError("; ".join(failures) + self._advice(one, part))

    def _advice(self, one: TypeAnnouncement, part: str) -> str:
        if self._subject.kind == "topic":
            return f"; {_WHAT_TO_DO}"
        return (
            f"; so nobody tells what {printable(one.type_name + part)} is (nodes of ROS 2 describe "
            f"{_KINDS[self._request.base]} only by its own hash, which they do not announce): {_WHAT_TO_DO}, "
            "or give that hash as type_hash"
        )

    def _announcing_nodes(self, one: TypeAnnouncement, wanted: str) -> set[str]:
        """The nodes that announce a hash; all of them when it is that of something which is not announced."""
        told = {node for by_hash in one.hashes.values() for node in by_hash.get(wanted, ())} - {""}
        return told or one.nodes()

    async def _fetch_sources(self, name: str, wanted: str, nodes: Collection[str]) -> None:
        """The whole of what is known in parts, for its sources; nobody has to have it."""
        try:
            await self._fetch(name, wanted, nodes)
        except TypeDescriptionError as error:
            self._scope.logger.debug(f"no sources of {name}: {error}")

    async def _fetch(self, name: str, wanted: str, nodes: Collection[str]) -> None:
        """Have a type described: from the disk, or by one of the nodes, of which several may be asked."""
        kept = await asyncio.to_thread(load_description, wanted)
        if kept is not None:
            try:
                await asyncio.to_thread(self._accept_answer, "the cache", name, wanted, kept)
            except RosidlError as error:
                self._scope.logger.warning(f"{error}; it is asked for again")
            else:
                return
        failures = []
        told = await self._named_nodes(nodes)
        asked = self._in_order(told)
        for index, node in enumerate(asked):
            try:
                answer = await self._ask(node, name, wanted, len(asked) - index)
                await asyncio.to_thread(self._accept_answer, node, name, wanted, answer)
            except ClosedError:
                raise
            except RosidlError as error:
                failures.append(str(error))
                continue
            await asyncio.to_thread(store_description, wanted, answer)
            return
        raise TypeDescriptionError(
            "; ".join(failures) or f"{name} {wanted} is announced, but {self._nobody_asked(told)}"
        )

    def _nobody_asked(self, told: Collection[str]) -> str:
        """Why there is nobody to ask among those who announce a type."""
        own = self._scope.node_name
        if own in told:
            return f"only by nodes called {own} as this one is, which would ask itself: give one of them another name"
        return "not by a node that has a name"

    async def _named_nodes(self, nodes: Collection[str]) -> Collection[str]:
        """The nodes, or those whose names come a moment later, when there is none but this one."""
        scope = self._scope
        if set(nodes) - {scope.node_name}:
            return nodes

        def late() -> set[str]:
            return set().union(*(one.nodes() for one in self._candidates()))

        def is_told() -> bool:
            return bool(late() - {scope.node_name}) or not any(one.has_unnamed() for one in self._candidates())

        await scope.wait_until(is_told, self._deadline.remaining_s(_NODE_NAME_TIMEOUT_S), lambda: scope.closed)
        return late()

    def _in_order(self, nodes: Collection[str]) -> list[str]:
        """Whom to ask, those first that are known to have the service; never this node, which waits for an answer."""
        others = sorted(set(nodes) - {self._scope.node_name})
        return sorted(others, key=lambda node: not self._serves(node))[:_MAX_ASKED]

    def _serves(self, node: str) -> bool:
        return bool(self._scope.graph.endpoints_on(TopicKey("reply", f"{node}/get_type_description"), writers=True))

    async def _ask(self, node: str, name: str, wanted: str, remaining: int) -> bytes:
        scope, service = self._scope, self._names.resolve_service(f"{node}/get_type_description")

        def limit_s(at_most_s: float) -> float:
            left_s = self._deadline.remaining_s()
            return at_most_s if left_s is None else min(at_most_s, left_s / remaining)

        patience_s = limit_s(_SERVICE_TIMEOUT_S)
        if not await scope.wait_until(lambda: self._serves(node), patience_s, lambda: scope.closed):
            raise CallTimeoutError(f"no server of {service} ({SERVICE}) appeared in {patience_s:.3g} s")
        return await request_type_description(scope, service, name, wanted, True, limit_s(_ANSWER_TIMEOUT_S))

    def _accept_answer(self, who: str, name: str, wanted: str, answer: bytes) -> None:
        """Use an answer; raises `TypeDescriptionError` for one that is about something else. Runs in a thread."""
        from rosidl_py_gen import to_dict

        if len(answer) > MAX_BYTES:
            raise TypeDescriptionError(f"{who} describes {name} in {len(answer)} bytes; expected at most {MAX_BYTES}")
        response = decode_description(who, answer)
        description = to_dict(response.type_description)
        told, found = description["type_description"]["type_name"], rihs01(description)
        if (told, found) != (name, wanted):
            raise TypeDescriptionError(
                f"{who} describes {printable(told)} with the hash {found}, but {name} with the hash {wanted} was "
                "announced: the answer is refused"
            )
        self._learned.who[who] = None
        everything = [description["type_description"], *description["referenced_type_descriptions"]]
        self._learned.individuals |= {one["type_name"]: one for one in everything}
        for source in response.type_sources:
            self._learned.sources.setdefault(source.type_name, (source.encoding, source.raw_file_contents))
