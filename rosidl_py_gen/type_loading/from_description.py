"""Classes from type descriptions that other nodes give.

Decides that a hash is enough: a class that is known here under the same name and hash is taken, nested ones too, and
nothing is compiled for it. What a description may say is decided in `compiler/frontend/type_description_reader.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr.typesupport import hashes_of, type_description, type_name
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.type_loading.class_lookup import class_of_registry, registry_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.base.descriptions import Description
    from rosidl_py_gen.type_loading.class_lookup import SearchFolders


_EVENT = "_Event"


def described_hashes(name: str, individuals: Mapping[str, Description], *, is_service: bool = False) -> dict[str, str]:
    """RIHS01 of a described type, and of all types that belong to it or that it refers to.

    Arguments and errors as of `compile_described`.
    """
    from rosidl_py_gen.compiler.frontend.type_description_reader import registry_from_descriptions

    return registry_from_descriptions(split_ros_name(name), individuals, {}, is_service).all_hashes(name)


def compile_described(
    name: str,
    individuals: Mapping[str, Description],
    sources: Mapping[str, tuple[str, str]],
    *,
    is_service: bool = False,
    path: SearchFolders = (),
) -> type[Any]:
    """The class of a described type.

    Args:
        individuals: the description of each type alone, by name; those of derived messages may be missing.
        sources: type name -> encoding and text. They add constants, comments and defaults where they say the same.
        is_service: `name` is that of a service; ``pkg/action/X_SendGoal`` does not tell.
        path: as for `get_message`.

    Raises:
        DefinitionError: no definition could have led to this, or it is too large. InvalidNameError.
    """
    from rosidl_py_gen.compiler.frontend.type_description_reader import registry_from_descriptions

    top = split_ros_name(name)
    return class_of_registry(registry_from_descriptions(top, individuals, sources, is_service), top, path=path)


def definition_text(cls: type[Any]) -> str:
    """The definition of a class with all types it uses, as bags carry it; `compile_definition` reads it.

    The text of the file when it is on the search path and says the same, with comments and constants; otherwise
    written from what the class knows. Messages that ROS derives, such as ``X_Event``, have the text of their service or
    action.

    Raises:
        TypeNotFoundError: not a generated message, service or action; or derived from a service or action that is not
            on the search path, and no event of a service.
    """
    from rosidl_py_gen.compiler.frontend.definition_text import full_text
    from rosidl_py_gen.compiler.frontend.type_description_reader import registry_from_descriptions

    name = split_ros_name(type_name(cls))
    registry = registry_of(name)
    if registry is None or registry.all_hashes(str(name)) != hashes_of(cls):
        is_event = name.kind == "srv" and name.name.endswith(_EVENT)  # which has request and response in it
        if is_event:
            name = name._replace(name=name.name.removesuffix(_EVENT))
        elif "_" in name.name:
            raise TypeNotFoundError(f"{name} belongs to a service or action that is not on the search path")
        told = type_description(cls)
        parts = [told["type_description"], *told["referenced_type_descriptions"]]
        registry = registry_from_descriptions(name, {one["type_name"]: one for one in parts}, {}, is_event)
    return full_text(registry, registry.owner(name) or name)
