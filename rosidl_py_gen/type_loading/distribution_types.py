"""Definitions that a type has in other ROS distributions than the distribution of its class.

A type may also differ because a type in it differs: `my_msgs/msg/Sonar` with a field `sensor_msgs/Range` has another
hash in each distribution whose `Range` differs. So the definition for a distribution is made from the type's own
definition, in which types that the distribution defines otherwise are replaced.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import full_description, individual_descriptions, rihs01
from rosidl_py_gen.base.distributions import DISTRIBUTIONS
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.cdr.layout import NETWORK_ALIGN
from rosidl_py_gen.cdr.structured_layout import cached_per_class
from rosidl_py_gen.cdr.type_queries import type_description
from rosidl_py_gen.errors import DecodeError, EncodeError
from rosidl_py_gen.type_loading.class_lookup import (
    distribution_definitions,
    find_class,
    find_installed_class,
    find_named_class,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.base.descriptions import Description
    from rosidl_py_gen.type_loading.class_lookup import SearchFolders


def other_hashes(cls: type[Any]) -> Mapping[str, str]:
    """Return the hashes that a class's type has in the distributions whose definition differs, oldest distribution
    first.
    """
    return {distro: rihs01(description) for distro, description in _other_descriptions(cls).items()}


def distributions_with(name: str, own_hash: str, other_hash: str) -> tuple[str, ...]:
    """Return the distributions whose definition of a type has a hash, oldest first; empty if no distribution has it.

    Args:
        own_hash: hash of the definition that this process uses.

    Raises:
        RosidlError: the name is invalid, or a definition cannot be read.
    """
    cls = find_class(name, lambda hashes: hashes[name] == own_hash)
    return () if cls is None else tuple(one for one, text in other_hashes(cls).items() if text == other_hash)


@cached_per_class
def class_in(distro: str, cls: type[Any]) -> type[Any]:
    """Return the class with the definition that a class's type has in a given distribution."""
    from rosidl_py_gen.type_loading.from_description import compile_described

    description = _other_descriptions(cls).get(distro)
    if description is None:
        return cls
    found: type[Any] = compile_described(cls._TYPE.name, individual_descriptions(description), {})
    return found


def find_class_of(distro: str, name: str, path: SearchFolders) -> type[Any] | None:
    """Return the class that nodes of a distribution use for a type, as far as it is known on this machine.

    Returns None if it is not known.
    """
    cls = find_named_class(name, path=path, distro=distro)
    if cls is None or not issubclass(cls, Message) or find_installed_class(split_ros_name(name)) is not cls:
        return cls
    # A generated class contains the types of the distribution for which it was generated.
    return class_in(distro, cls)


def fits_exactly(cls: type[Any], data: Any) -> bool:
    """Return True if data is exactly one message of the class; after it, only the padding of the network may follow."""
    try:
        size = len(cls._decode(data)._encode())
    except (DecodeError, EncodeError):
        return False
    return 0 <= len(data) - size < NETWORK_ALIGN


@cached_per_class
def _other_descriptions(cls: type[Any]) -> Mapping[str, Description]:
    own_hash, description = cls._TYPE.hash, type_description(cls)
    if rihs01(description) != own_hash:  # a class of raw data has a hash without the fields
        return {}
    individuals = individual_descriptions(description)
    replaced: dict[str, dict[str, Description]] = {distro: {} for distro in DISTRIBUTIONS}
    for name, own in individuals.items():
        for definition in distribution_definitions(name):
            found = type_description(definition.load())
            if _fields(found["type_description"]) != _fields(own):
                for distro in definition.distributions:
                    replaced[distro].update(individual_descriptions(found))
    others = {
        distro: full_description(cls._TYPE.name, {**individuals, **parts}.__getitem__)
        for distro, parts in replaced.items()
        if parts
    }
    return {distro: other for distro, other in others.items() if rihs01(other) != own_hash}


def _fields(description: Description) -> list[tuple[object, object]]:
    return [(field["name"], field["type"]) for field in description["fields"]]
