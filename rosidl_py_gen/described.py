"""Classes from type descriptions that other nodes give.

Decides that a hash is enough: a class that is known here under the same name and hash is taken, nested ones too, and
nothing is compiled for it. What a description may say is decided in `spec/described.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.dynamic import class_of_library
from rosidl_py_gen.names import split_ros_name

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.descriptions import Description
    from rosidl_py_gen.dynamic import Folders


def described_hashes(name: str, individuals: Mapping[str, Description], *, is_service: bool = False) -> dict[str, str]:
    """RIHS01 of a described type, and of all types that belong to it or that it refers to.

    Arguments and errors as of `compile_described`.
    """
    from rosidl_py_gen.spec.described import described_library

    return described_library(split_ros_name(name), individuals, {}, is_service).all_hashes(name)


def compile_described(
    name: str,
    individuals: Mapping[str, Description],
    sources: Mapping[str, tuple[str, str]],
    *,
    is_service: bool = False,
    path: Folders = (),
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
    from rosidl_py_gen.spec.described import described_library

    top = split_ros_name(name)
    return class_of_library(described_library(top, individuals, sources, is_service), top, path=path)
