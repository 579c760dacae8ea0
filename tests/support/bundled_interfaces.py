"""The interfaces in the checkout and the recorded vectors, for tests that go through all of them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from rosidl_py_gen import Message, get_message
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check, select
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from support.reference_cdr import Reference

TESTS = Path(__file__).resolve().parents[1]
INTERFACES = TESTS / "interfaces"
_SEARCH = (str(INTERFACES),)


@dataclass(frozen=True)
class Vector:
    """Bytes that another implementation wrote, and the plain value that they encode."""

    type: str
    value: dict[str, Any]
    cdr: bytes


@lru_cache(maxsize=1)
def vectors() -> tuple[Vector, ...]:
    lines = (TESTS / "vectors" / "cdr_vectors.jsonl").read_text(encoding="utf-8").splitlines()
    rows = map(json.loads, lines)
    return tuple(Vector(row["type"], row["value"], bytes.fromhex(row["cdr"])) for row in rows)


def vectors_by_type() -> dict[str, list[Vector]]:
    found: dict[str, list[Vector]] = {}
    for vector in vectors():
        found.setdefault(vector.type, []).append(vector)
    return found


@lru_cache(maxsize=1)
def library() -> InterfaceRegistry:
    """The bundled interfaces and those below tests/interfaces."""
    return InterfaceRegistry(SearchPath.scan(_SEARCH, ament=""))


def reference() -> Reference:
    return Reference(library().message)


@lru_cache(maxsize=1)
def message_names() -> tuple[str, ...]:
    """Return the names of all messages in `library`, including the messages of services and actions."""
    names = select(library(), [])
    check(library(), names)
    library().raise_diagnostics()
    interfaces = [library().interface(name) for name in names]
    return tuple(str(message.name) for one in interfaces if one is not None for message in one.messages)


def message(name: str) -> type[Message]:
    """Return the class of a message in `library`."""
    return get_message(name, path=_SEARCH)
