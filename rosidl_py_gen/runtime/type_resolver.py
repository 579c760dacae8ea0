"""Search for the class of a type that other nodes announce.

The order of the search is: a local class with the announced hash, the cache on disk, one of the announcing nodes. A
description is used only if its hash is the announced one. Slow steps run in a thread.

Nodes of ROS 2 Humble announce no hash. Then the class is found by the type's name, with the definitions of Humble if
all publishers or servers are nodes of Humble.
"""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import TypeDescriptions
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.cdr import Action, Message, Service
from rosidl_py_gen.cdr.type_queries import hashes_of, type_hash
from rosidl_py_gen.errors import (
    ClosedError,
    DefinitionError,
    InvalidNameError,
    RosidlError,
    TypeNotFoundError,
    printable,
)
from rosidl_py_gen.runtime.entities.services import CallTimeoutError
from rosidl_py_gen.runtime.time_values import Deadline
from rosidl_py_gen.runtime.transport.api import TopicKey
from rosidl_py_gen.runtime.type_descriptions import (
    TYPE_DESCRIPTION_SERVICE,
    TYPE_HASH,
    TypeDescriptionError,
    announced,
    decode_description,
    is_complete,
    join_truncated,
    participants_of,
    provider_participants,
    request_type_description,
)
from rosidl_py_gen.type_loading import CachedDescription

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from rosidl_py_gen.base.descriptions import Description
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names import NodeNames
    from rosidl_py_gen.runtime.type_descriptions import TypeAnnouncement, TypeQuery
    from rosidl_py_gen.type_loading import SearchFolders

ANSWER_TIMEOUT_S = 3.0
"""Maximum time in seconds to wait for a node's type description before the next node is requested."""
_SERVICE_TIMEOUT_S = 1.0
"""Maximum time in seconds to wait for a node's service ``~/get_type_description``, which a node may not have."""
_NODE_NAME_TIMEOUT_S = 4.0
"""Maximum time in seconds to wait for node names; with Fast DDS they may arrive after 3 s
(docs/internals/protocol.md 6)."""
_LATE_ANNOUNCEMENT_GRACE_S = 2.0
"""Time in seconds to wait for endpoints that a node announces after its other endpoints.

Fast DDS repeats a lost announcement after 1 s.
"""
_MAX_ASKED_NODES = 8
_HUMBLE = "humble"
_KINDS = {Message: "a message", Service: "a service", Action: "an action"}
_ADVICE = "install its package, or add it to the search path (`path=`, `--path`, AMENT_PREFIX_PATH)"


class TypeResolver:
    """Search for the class of the type of one topic, service or action.

    `Node.resolve_type` documents arguments and exceptions.
    """

    def __init__(
        self,
        scope: EntityScope,
        names: NodeNames,
        query: TypeQuery,
        base: type[Any],
        type_name: str | None,
        wanted_hash: str | None,
        path: SearchFolders,
        timeout_s: float | None,
    ) -> None:
        if type_name is not None:
            RosName.parse(type_name)
        if wanted_hash is not None and not TYPE_HASH.match(wanted_hash):
            raise TypeDescriptionError(
                f"type_hash: got {wanted_hash!r:.100}; expected RIHS01_ and 64 hexadecimal digits"
            )
        self._scope = scope
        self._names = names
        self._query = query
        self._subject = f"the {query.kind} {query.name}"
        self._base = base
        self._type_name = type_name
        self._wanted_hash = wanted_hash
        self._path = path
        self._timeout_s = timeout_s
        self._deadline = Deadline(timeout_s)
        # Descriptions that nodes returned, by type name; all of them have the announced hash.
        self._senders: dict[str, None] = {}
        self._individuals: dict[str, Description] = {}
        self._sources: dict[str, tuple[str, str]] = {}

    async def run(self) -> Any:
        """Search for the class, and return it."""
        cls = await self._find_or_fetch()
        if not issubclass(cls, self._base):
            raise TypeDescriptionError(
                f"{self._subject} has the type {cls._TYPE.name}, which is not {_KINDS[self._base]}"
            )
        return cls

    async def _find_or_fetch(self) -> type[Any]:
        announcement = await self._wait_for_announcement()
        if not announcement.has_hashes():
            return await self._find_by_name(announcement)
        cls = await self._find_local(announcement, self._matches(announcement))
        if cls is not None:
            return cls
        try:
            return await self._fetch_with_late_announcements(announcement)
        except TypeDescriptionError as error:
            other = await self._find_local(announcement, lambda hashes: True)
            if other is None:
                raise
            text = f"{error}; the local definition has another hash, {type_hash(other)}"
            raise TypeDescriptionError(text) from error

    def _announcements(self, participants: Collection[bytes] = ()) -> dict[str, TypeAnnouncement]:
        return announced(self._scope.graph, self._query, participants)

    def _candidates(self, participants: Collection[bytes] = ()) -> list[TypeAnnouncement]:
        """Return the types whose required messages are all announced; if the caller named a type, only that type.

        Args:
            participants: GUIDs of the participants whose announcements count; empty: all participants.
        """
        return [
            announcement
            for announcement in self._announcements(participants).values()
            if is_complete(announcement, self._query) and self._type_name in (None, announcement.type_name)
        ]

    async def _wait_for_announcement(self) -> TypeAnnouncement:
        scope = self._scope
        scope.discovery.refresh()
        if not await scope.wait_until(lambda: bool(self._candidates()), self._timeout_s):
            raise CallTimeoutError(self._not_announced_text())
        candidates = self._candidates()
        if len(candidates) > 1 or (self._wanted_hash is None and candidates[0].is_ambiguous()):
            # The types of publishers and servers in other processes are preferred.
            providers = {*provider_participants(scope.graph, self._query)}
            candidates = self._candidates(providers - {scope.participant.guid} or providers) or candidates
        if len(candidates) > 1:
            raise self._ambiguous_error("types", candidates, "type_name")
        if self._wanted_hash is None and candidates[0].is_ambiguous():
            raise self._ambiguous_error("definitions", candidates, "type_hash")
        try:
            RosName.parse(candidates[0].type_name)
        except InvalidNameError:
            text = join_truncated(candidates[0].lines())
            raise TypeDescriptionError(f"the type of {self._subject} is not a ROS type: {text}") from None
        return candidates[0]

    def _not_announced_text(self) -> str:
        lines = [line for announcement in self._announcements().values() for line in announcement.lines()]
        wanted = f"the type {self._type_name}" if self._type_name else "a type"
        existing = f"; announced are {join_truncated(lines)}" if lines else ""
        return f"no node announced {wanted} for {self._subject} in {self._timeout_s} s{existing}"

    def _ambiguous_error(
        self, plural: str, announcements: list[TypeAnnouncement], parameter: str
    ) -> TypeDescriptionError:
        lines = [line for item in sorted(announcements, key=lambda item: item.type_name) for line in item.lines()]
        return TypeDescriptionError(f"{self._subject} has several {plural}: {join_truncated(lines)}; pass {parameter}")

    def _matches(self, announcement: TypeAnnouncement) -> Callable[[Mapping[str, str]], bool]:
        """Return a function that returns True if the hashes of a definition, by message type, are among the announced
        hashes.
        """
        wanted_hash = self._wanted_hash

        def matches(hashes: Mapping[str, str]) -> bool:
            announced_hashes = {name: set(by_hash) - {""} for name, by_hash in announcement.hashes.items()}
            is_announced = all(hashes.get(name) in texts for name, texts in announced_hashes.items() if texts)
            return is_announced and wanted_hash in (None, hashes.get(announcement.type_name))

        return matches

    async def _find_local(
        self, announcement: TypeAnnouncement, matches: Callable[[Mapping[str, str]], bool]
    ) -> type[Any] | None:
        from rosidl_py_gen.type_loading import ClassSearch

        return await asyncio.to_thread(ClassSearch(self._path).find, announcement.type_name, matches)

    async def _find_by_name(self, announcement: TypeAnnouncement) -> type[Any]:
        """Return the local class of a type for which no hash is announced, with a log entry that it may differ.

        Raises:
            TypeNotFoundError: there is no local definition, or no local definition with the hash that the caller
                passed.
        """
        from rosidl_py_gen.type_loading import ClassSearch, DistributionVariants

        name, path = announcement.type_name, self._path
        reason = f"the nodes of {self._subject} announce no hash for {name}, as nodes of ROS 2 Humble do"
        if self._wanted_hash:
            cls = await self._find_local(announcement, self._matches(announcement))
            if cls is None:
                raise TypeNotFoundError(f"{reason}, and no local definition has the hash; {_ADVICE}")
        else:
            try:
                cls = await asyncio.to_thread(ClassSearch(path).get, name)
                of_humble = await asyncio.to_thread(DistributionVariants.get_class, name, _HUMBLE, path)
            except TypeNotFoundError:
                raise TypeNotFoundError(f"{reason}, and there is no local definition; {_ADVICE}") from None
            if hashes_of(cls) != hashes_of(of_humble) and await self._are_of_humble():
                self._scope.logger.warning(
                    f"{reason}; using the definition of Humble, which differs from the local one"
                )
                return of_humble
        is_expected = Distribution.selected().name == "humble"
        level = logging.DEBUG if is_expected else logging.WARNING
        self._scope.logger.log(level, f"{reason}; using the local definition, which may differ from theirs")
        return cls

    async def _are_of_humble(self) -> bool:
        """Wait for the graph messages of the other participants; return True if all of them are nodes of ROS 2 Humble.

        Participants that only subscribe or call count if there is no publisher or server.
        """
        scope, graph = self._scope, self._scope.graph

        def participants() -> set[bytes]:
            own = {scope.participant.guid}
            return {*provider_participants(graph, self._query)} - own or {*participants_of(graph, self._query)} - own

        def is_known(guid: bytes) -> bool:
            return not graph.is_ros(guid) or graph.is_humble(guid) is not None or graph.node_names_complete(guid)

        timeout_s = self._deadline.remaining_s(_NODE_NAME_TIMEOUT_S)
        await scope.wait_until(lambda: all(map(is_known, participants())), timeout_s)
        found = participants()
        # All later distributions announce a hash, so a node that has sent no graph message is of Humble, too.
        return bool(found) and all(graph.is_ros(one) and graph.is_humble(one) is not False for one in found)

    async def _fetch_with_late_announcements(self, announcement: TypeAnnouncement) -> type[Any]:
        """Request the type from nodes; retry if an optional message, such as a service event, is announced late."""
        try:
            return await self._fetch_class(announcement)
        except TypeDescriptionError:
            scope, previous_count = self._scope, len(announcement.hashes)

            def has_more() -> bool:
                current = self._announcements().get(announcement.type_name)
                return current is not None and len(current.hashes) > previous_count

            names = (announcement.type_name + suffix for suffix in self._query.optional.values())
            is_incomplete = any(name not in announcement.hashes for name in names)
            grace_s = self._deadline.remaining_s(_LATE_ANNOUNCEMENT_GRACE_S) if is_incomplete else 0.0
            if not await scope.wait_until(has_more, grace_s):
                raise
            return await self._fetch_class(await self._wait_for_announcement())

    async def _fetch_class(self, announcement: TypeAnnouncement) -> type[Any]:
        from rosidl_py_gen.type_loading import DescribedType

        name, is_service = announcement.type_name, self._query.kind == "service"
        wanted_hash = self._wanted_hash
        if wanted_hash is not None:
            await self._fetch(name, wanted_hash, _announcing_nodes(announcement, wanted_hash))
        else:
            await self._fetch_messages(announcement)
        try:
            # Later descriptions and sources are added to the same dicts.
            described = DescribedType(name, self._individuals, self._sources, is_service=is_service)
            if name not in self._individuals:
                hashes = await asyncio.to_thread(described.hashes)
                self._require_match(announcement, hashes)
                try:  # only for the sources; a node may not have the whole type
                    await self._fetch(name, hashes[name], announcement.nodes())
                except TypeDescriptionError as error:
                    self._scope.logger.debug(f"no sources of {name}: {error}")
            cls = await asyncio.to_thread(described.load, self._path)
        except DefinitionError as error:
            raise TypeDescriptionError(
                f"the description of {name} by {join_truncated(self._senders)} cannot be used: {error}"
            ) from error
        self._require_match(announcement, hashes_of(cls))
        return cls

    def _require_match(self, announcement: TypeAnnouncement, hashes: Mapping[str, str]) -> None:
        """Raise `TypeDescriptionError` unless all hashes of the description are announced, as messages may be of
        different definitions.
        """
        if not self._matches(announcement)(hashes):
            raise self._ambiguous_error("definitions", [announcement], "type_hash")

    async def _fetch_messages(self, announcement: TypeAnnouncement) -> None:
        """Fetch descriptions of all sections of the type, each from the first available message that contains it.

        Raises:
            TypeDescriptionError: no node describes a message with one of the sections.
        """
        for suffix, carriers in self._query.messages.items():
            name = announcement.type_name + suffix
            failures: list[str] = []
            for carrier in carriers:
                if name in self._individuals:
                    break
                for wanted_hash in announcement.nodes_by_hash(carrier):
                    nodes = _announcing_nodes(announcement, wanted_hash)
                    try:
                        await self._fetch(announcement.type_name + carrier, wanted_hash, nodes)
                    except TypeDescriptionError as error:
                        failures.append(str(error))
            if name not in self._individuals:
                raise TypeDescriptionError("; ".join(failures) + self._hint(name))

    def _hint(self, name: str) -> str:
        if self._query.kind == "topic":
            return f"; {_ADVICE}"
        return (
            f"; so no node describes {printable(name)} (nodes of ROS 2 describe {_KINDS[self._base]} only by "
            f"its own hash, which they do not announce): {_ADVICE}, or pass that hash as type_hash"
        )

    async def _fetch(self, name: str, wanted_hash: str, nodes: Collection[str]) -> None:
        """Load a type description from the cache on disk, or request it from the nodes, one after the other.

        Raises:
            TypeDescriptionError: no node has described the type.
        """
        cache = CachedDescription(wanted_hash)
        cached = await asyncio.to_thread(cache.load)
        if cached is not None:
            try:
                await asyncio.to_thread(self._accept, "the cache", name, wanted_hash, cached)
            except RosidlError as error:
                self._scope.logger.warning(f"{error}; requesting it again")
            else:
                return
        failures = []
        known_nodes = await self._wait_for_names(nodes)
        others = sorted(set(known_nodes) - {self._scope.node_name})  # a request to itself would never return
        asked = sorted(others, key=lambda node: not self._serves(node))[:_MAX_ASKED_NODES]
        for index, node in enumerate(asked):
            try:
                data = await self._request_from(node, name, wanted_hash, len(asked) - index)
                await asyncio.to_thread(self._accept, node, name, wanted_hash, data)
            except ClosedError:
                raise
            except RosidlError as error:
                failures.append(str(error))
                continue
            await asyncio.to_thread(cache.store, data)
            return
        own = self._scope.node_name
        reason = (
            f"only by nodes with the name of this one, {own}, which cannot ask itself; rename one of them"
            if own in known_nodes
            else "not by a node that has a name"
        )
        raise TypeDescriptionError("; ".join(failures) or f"{name} {wanted_hash} is announced, but {reason}")

    async def _wait_for_names(self, nodes: Collection[str]) -> Collection[str]:
        """Return the given nodes.

        If this node is the only one of them, first wait for names of further announcing nodes.
        """
        scope = self._scope
        if set(nodes) - {scope.node_name}:
            return nodes

        def all_nodes() -> set[str]:
            return set().union(*(announcement.nodes() for announcement in self._candidates()))

        def is_over() -> bool:
            return bool(all_nodes() - {scope.node_name}) or not any(
                announcement.has_unnamed() for announcement in self._candidates()
            )

        await scope.wait_until(is_over, self._deadline.remaining_s(_NODE_NAME_TIMEOUT_S))
        return all_nodes()

    def _serves(self, node: str) -> bool:
        return bool(self._scope.graph.endpoints_on(TopicKey("reply", f"{node}/get_type_description"), writers=True))

    async def _request_from(self, node: str, name: str, wanted_hash: str, remaining_nodes: int) -> bytes:
        scope, service = self._scope, self._names.resolve_service(f"{node}/get_type_description")

        def timeout_s(max_s: float) -> float:
            left_s = self._deadline.remaining_s()
            return max_s if left_s is None else min(max_s, left_s / remaining_nodes)

        service_timeout_s = timeout_s(_SERVICE_TIMEOUT_S)
        if not await scope.wait_until(lambda: self._serves(node), service_timeout_s):
            raise CallTimeoutError(
                f"no server of {service} ({TYPE_DESCRIPTION_SERVICE}) appeared in {service_timeout_s:.3g} s"
            )
        return await request_type_description(scope, service, name, wanted_hash, True, timeout_s(ANSWER_TIMEOUT_S))

    def _accept(self, sender: str, name: str, wanted_hash: str, data: bytes) -> None:
        """Store the type description in an encoded response of a node or of the cache. Thread: any.

        Raises:
            TypeDescriptionError: the response is too large, a failure, or describes another type or hash.
        """
        from rosidl_py_gen import to_dict

        if len(data) > CachedDescription.MAX_BYTES:
            raise TypeDescriptionError(
                f"{sender} describes {name} in {len(data)} bytes; expected at most {CachedDescription.MAX_BYTES}"
            )
        response = decode_description(sender, data)
        description = to_dict(response.type_description)
        described, found_hash = description["type_description"]["type_name"], TypeDescriptions.rihs01(description)
        if (described, found_hash) != (name, wanted_hash):
            raise TypeDescriptionError(
                f"{sender} describes {printable(described)} with the hash {found_hash}, but {name} with the hash "
                f"{wanted_hash} was announced: the description is refused"
            )
        self._senders[sender] = None
        individuals = [description["type_description"], *description["referenced_type_descriptions"]]
        self._individuals |= {individual["type_name"]: individual for individual in individuals}
        for source in response.type_sources:
            self._sources.setdefault(source.type_name, (source.encoding, source.raw_file_contents))


def _announcing_nodes(announcement: TypeAnnouncement, wanted_hash: str) -> set[str]:
    """Return the nodes that announce a hash; if none announces it, return all nodes that announce the type."""
    nodes = {node for by_hash in announcement.hashes.values() for node in by_hash.get(wanted_hash, ())} - {""}
    return nodes or announcement.nodes()
