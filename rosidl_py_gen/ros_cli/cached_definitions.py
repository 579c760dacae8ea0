"""Definitions that other nodes described once, and that are kept on disk: for types that are not on the search path.

Decides which of them belong to a name: a description that contains all of it, the newest first, else what was learned
of the halves of a service or the parts of an action, if nothing of that contradicts. Files whose hash is not that of
their name are passed over. Needs no network.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.descriptions import rihs01
from rosidl_py_gen.base.names import KINDS, RosName, split_ros_name
from rosidl_py_gen.compiler.frontend.type_description_reader import registry_from_descriptions, written_messages
from rosidl_py_gen.errors import InvalidNameError, RosidlError
from rosidl_py_gen.ros_cli import ToolError, terminal_output
from rosidl_py_gen.type_loading.description_cache import cached_descriptions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.base.descriptions import Description
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


class _CachedDescriptions(NamedTuple):
    individuals: dict[str, Description]
    sources: dict[str, tuple[str, str]]


def cached_registry(text: str) -> tuple[InterfaceRegistry, RosName] | None:
    """What is kept of ``pkg/kind/Name``, or of ``pkg/Name`` of any kind; None when there is nothing.

    What is taken is said on standard error, and which other definitions of that name there are.

    Raises:
        ToolError: what is kept of the parts of a service or an action contradicts itself.
    """
    for name in _names(text):
        mentioned = list(_all(name))
        found = _by_hash(name, mentioned) or _joined(name, mentioned)
        if found:
            (used, library), others = next(iter(found.items())), list(found)[1:]
            more = f"; other definitions of it are kept, too: {', '.join(others)}" if others else ""
            terminal_output.note(
                f"{name} is not on the search path: this is what a node said of it once ({used}){more}"
            )
            return library, name
    return None


def _names(text: str) -> Iterator[RosName]:
    for kind in KINDS if text.count("/") == 1 else ("msg",) if "/" in text else ():
        try:
            yield split_ros_name(text, kind)
        except InvalidNameError:
            return


def _all(name: RosName) -> Iterator[_CachedDescriptions]:
    """Every description that has to do with a name, the newest first."""
    from rosidl_py_gen import to_dict
    from rosidl_py_gen.msgs.type_description_interfaces.srv import GetTypeDescription_Response

    for type_hash, data in cached_descriptions(containing=str(name).encode()):
        try:
            response = GetTypeDescription_Response.decode(data)
            told = to_dict(response.type_description)
            if rihs01(told) != type_hash:
                continue
        except (RosidlError, ValueError, LookupError):
            continue
        every = [told["type_description"], *told["referenced_type_descriptions"]]
        sources = {one.type_name: (one.encoding, one.raw_file_contents) for one in response.type_sources}
        yield _CachedDescriptions({one["type_name"]: one for one in every}, sources)


def _by_hash(name: RosName, kept: list[_CachedDescriptions]) -> dict[str, InterfaceRegistry]:
    """The definitions of a name that are whole, by hash."""
    is_service = name.kind == "srv" and "_" not in name.name
    found: dict[str, InterfaceRegistry] = {}
    for one in kept:
        if all(part in one.individuals for part in written_messages(name, is_service)):
            with suppress(RosidlError):  # it is none of ours, or too large
                library = registry_from_descriptions(name, one.individuals, one.sources, is_service)
                found.setdefault(library.type_hash(str(name)), library)
    return found


def _joined(name: RosName, kept: list[_CachedDescriptions]) -> dict[str, InterfaceRegistry]:
    """The one definition that all parts together make."""
    parts = written_messages(name, name.kind == "srv" and "_" not in name.name)
    joined = _CachedDescriptions({}, {})
    for one in [one for one in kept if len(parts) > 1 and not one.individuals.keys().isdisjoint(parts)]:
        for part, description in one.individuals.items():
            if joined.individuals.setdefault(part, description) != description:
                raise ToolError(
                    f"{name} is not on the search path, and what nodes said of its parts is of several definitions "
                    f"of {part}: ask a node that is there (rosidl-py topic info -v), or give --path"
                )
        for part, source in one.sources.items():
            joined.sources.setdefault(part, source)
    return _by_hash(name, [joined])
