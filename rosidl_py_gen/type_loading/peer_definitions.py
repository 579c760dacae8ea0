"""Definitions that peers of other ROS distributions use for a type, and the conversion of their samples.

The definition of a peer is identified by the RIHS01 hash that it announces. A type may also differ because a type that
it refers to does: `my_msgs/msg/Sonar` with a field `sensor_msgs/Range` has another hash in each distribution whose
`Range` differs. So the hash of a type in a distribution is computed from the own definition, with those types replaced
that the distribution defines otherwise.

Fields are converted by the rules of ``rosidl-py bag migrate``: by name, to defaults where the peer has no such field. A
value that does not fit is refused.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.base.descriptions import full_description, individual_descriptions, rihs01
from rosidl_py_gen.base.distributions import DISTRIBUTIONS
from rosidl_py_gen.base.generated_classes import find_installed_class
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.cdr.layout import NETWORK_ALIGN
from rosidl_py_gen.cdr.structured_layout import cached_per_class
from rosidl_py_gen.cdr.type_queries import type_description
from rosidl_py_gen.errors import DecodeError, EncodeError, RosidlError
from rosidl_py_gen.type_loading.class_lookup import distribution_definitions, find_named_class

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.base.descriptions import Description
    from rosidl_py_gen.type_loading.class_lookup import SearchFolders

_lock = threading.RLock()


class UnconvertibleDefinitionError(RosidlError):
    """Error of two definitions whose messages cannot be converted; the text names the fields."""


class PeerDefinition(NamedTuple):
    """Definition that a type has in other distributions.

    Attributes:
        distros: the distributions that have it, oldest first.
        individuals: description of each single type in it, by name.
    """

    type_name: str
    type_hash: str
    distros: tuple[str, ...]
    individuals: Mapping[str, Description]


class SampleConverter(NamedTuple):
    """Conversion of encoded messages from an old definition to a new one.

    Attributes:
        dropped: fields of the old definition that the new one does not have, as ``pkg/msg/Name.field``.
        defaulted: fields of the new definition that the old one does not have.
    """

    old: type[Message]
    new: type[Message]
    dropped: tuple[str, ...]
    defaulted: tuple[str, ...]
    convert: Callable[[Any], Any]

    def encode(self, data: Any) -> bytes:
        """Return a sample converted to the new definition.

        Raises:
            DecodeError: the data is not a message of the old definition.
            EncodeError: a value does not fit the new definition.
        """
        return self.convert(self.old._decode(data))._encode()  # type: ignore[no-any-return]

    def __call__(self, data: Any) -> bytes:
        """Return a sample converted to the new definition.

        Raises:
            DecodeError: the data is not a message of the old definition, or a value does not fit the new one.
        """
        try:
            return self.encode(data)
        except EncodeError as error:
            raise DecodeError(error.path, 0, f"cannot be converted to the definition in use: {error.reason}") from None


def peer_definitions(cls: type[Message]) -> Mapping[str, PeerDefinition]:
    """Return the definitions of a class's type in other distributions, by RIHS01 hash; an equal one is omitted."""
    info = cls._TYPE
    with _lock:
        return _peer_definitions(info.name, info.hash, cls)


def find_class_of(distro: str, name: str, path: SearchFolders) -> type[Any] | None:
    """Return the class of a type that nodes of a distribution use, as far as known; None if no class is known."""
    cls = find_named_class(name, path=path, distro=distro)
    if cls is None or not issubclass(cls, Message) or find_installed_class(split_ros_name(name)) is not cls:
        return cls
    # A generated class contains the types of the distribution for which it was generated.
    definition = next((one for one in peer_definitions(cls).values() if distro in one.distros), None)
    if definition is None:
        return cls
    with _lock:
        return _peer_class(definition)


def converter_from(definition: PeerDefinition, cls: type[Message]) -> SampleConverter:
    """Return the conversion of a peer's samples to samples of a class.

    Raises:
        UnconvertibleDefinitionError: the definitions differ too much.
    """
    with _lock:
        return _converter(_peer_class(definition), cls)


def converter_to(definition: PeerDefinition, cls: type[Message]) -> SampleConverter:
    """Return the conversion of samples of a class to samples of a peer.

    Raises:
        UnconvertibleDefinitionError: the definitions differ too much.
    """
    with _lock:
        return _converter(cls, _peer_class(definition))


def part_of(definition: PeerDefinition, name: str) -> PeerDefinition:
    """Return the definition of a type that a peer's definition refers to, such as the request of its service."""
    full = full_description(name, definition.individuals.__getitem__)
    return definition._replace(type_name=name, type_hash=rihs01(full))


def fits_exactly(cls: type[Message], data: Any) -> bool:
    """Return True if data is a message of the class with nothing after it except the padding of the network."""
    try:
        size = len(cls._decode(data)._encode())
    except (DecodeError, EncodeError):
        return False
    return 0 <= len(data) - size < NETWORK_ALIGN


_by_hash: dict[tuple[str, str], Mapping[str, PeerDefinition]] = {}


def _peer_definitions(name: str, own_hash: str, cls: type[Message]) -> Mapping[str, PeerDefinition]:
    found = _by_hash.get((name, own_hash))
    if found is None:
        description = type_description(cls)
        # A class of raw data has a hash without the fields.
        found = _find(name, own_hash, individual_descriptions(description)) if rihs01(description) == own_hash else {}
        _by_hash[name, own_hash] = found
    return found


def _find(name: str, own_hash: str, individuals: Mapping[str, Description]) -> dict[str, PeerDefinition]:
    found: dict[str, PeerDefinition] = {}
    for distro, replaced in _replaced_descriptions(individuals).items():
        full = full_description(name, {**individuals, **replaced}.__getitem__)
        type_hash = rihs01(full)
        if type_hash == own_hash:
            continue
        distros = (*found[type_hash].distros, distro) if type_hash in found else (distro,)
        found[type_hash] = PeerDefinition(name, type_hash, distros, individual_descriptions(full))
    return found


def _replaced_descriptions(individuals: Mapping[str, Description]) -> dict[str, dict[str, Description]]:
    """Return by distribution the descriptions of types that it defines otherwise, and of the types they refer to."""
    by_distro: dict[str, dict[str, Description]] = {distro: {} for distro in DISTRIBUTIONS}
    for type_name, own in individuals.items():
        for definition in distribution_definitions(type_name):
            description = type_description(definition.load())
            if _fields(description["type_description"]) != _fields(own):
                for distro in definition.distributions:
                    by_distro[distro].update(individual_descriptions(description))
    return {distro: replaced for distro, replaced in by_distro.items() if replaced}


def _fields(description: Description) -> list[tuple[object, object]]:
    return [(field["name"], field["type"]) for field in description["fields"]]


_peer_classes: dict[tuple[str, str], type[Message]] = {}


def _peer_class(definition: PeerDefinition) -> type[Message]:
    from rosidl_py_gen.type_loading.from_description import compile_described

    key = definition.type_name, definition.type_hash
    if key not in _peer_classes:
        _peer_classes[key] = compile_described(definition.type_name, definition.individuals, {})
    return _peer_classes[key]


@cached_per_class
def _converter(old: type[Message], new: type[Message]) -> SampleConverter:
    from rosidl_py_gen.compiler.compatibility.migration import MigrationError, fields_of, message_converter, plan

    try:
        plans = plan(fields_of(old), fields_of(new), old._TYPE.name, None)
    except MigrationError as error:
        raise UnconvertibleDefinitionError("; ".join(str(error).splitlines())) from None
    dropped = tuple(f"{one.old}.{field}" for one in plans.values() for field in one.dropped)
    defaulted = tuple(f"{one.new}.{field}" for one in plans.values() for field in one.defaulted)
    return SampleConverter(old, new, dropped, defaulted, message_converter(plans, old, new))
