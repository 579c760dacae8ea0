"""Properties of messages that decide how code is generated: inline, by call, or from a table.

Generated code stays in proportion to the definition: its size is that of the leaves, the fields of a message after
nested messages are flattened.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.layout import has_fixed_size

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import MessageDef

MAX_INLINE_FIELDS = 48
"""Maximum leaves of a nested message that is emitted inline. It bounds the generated code to a multiple of the
definition; every common message (Odometry has 22 leaves, Marker 43) stays flat."""
MAX_INLINE_DEPTH = 12
MAX_INLINE_LOOPS = 5
"""Maximum nested loops that are emitted inline: CPython accepts 20, and each is planned up to four times."""
MAX_CODEC_LEAVES = 500
"""Leaves above which a message has no generated codec, but that of `cdr.table_coded`: CPython takes 40 kB to compile
the code for one string. Messages of public packages have up to 70 fields."""

_Self = TypeVar("_Self", bound="MessageProperties")
_Result = TypeVar("_Result")


def cached_per_name(method: Callable[[_Self, str], _Result]) -> Callable[[_Self, str], _Result]:
    """Cache the result of a method for each message name."""

    @wraps(method)
    def cached(self: _Self, name: str) -> _Result:
        results = self.results.setdefault(method.__name__, {})
        if name not in results:
            results[name] = method(self, name)
        result: _Result = results[name]
        return result

    return cached


class MessageProperties:
    """Properties of messages by name.

    Args:
        lookup: returns the definition of a message.
        max_leaves: leaves of all messages together that get a codec of their own; all others are coded from a table.
    """

    def __init__(self, lookup: Callable[[str], MessageDef | None], max_leaves: float) -> None:
        self._lookup = lookup
        self._leaves_left = max_leaves
        self.results: dict[str, dict[str, Any]] = {}

    def message(self, name: str) -> MessageDef:
        """Return the definition of a message that exists."""
        message = self._lookup(name)
        assert message is not None, name  # references were checked before
        return message

    def is_outlined(self, name: str) -> bool:
        """Return True if the codec of the message is called where other messages contain it."""
        levels, loops = self.nesting_depth(name)
        return self.inline_size(name) > MAX_INLINE_FIELDS or levels > MAX_INLINE_DEPTH or loops > MAX_INLINE_LOOPS

    @cached_per_name
    def is_table_coded(self, name: str) -> bool:
        """Return True if a codec of its own would be out of proportion to the definition."""
        weight = self.inline_size(name)
        is_table_coded = weight > min(MAX_CODEC_LEAVES, self._leaves_left)
        self._leaves_left -= 0 if is_table_coded else weight
        return is_table_coded

    @cached_per_name
    def nesting_depth(self, name: str) -> tuple[int, int]:
        """Return the levels of nested messages, and of loops over them, that are emitted inline in a message."""
        levels = loops = 0
        for item in self.message(name).fields:
            if item.type.is_message:
                below, within = (0, 0) if self.is_outlined(item.type.base) else self.nesting_depth(item.type.base)
                levels = max(levels, below + 1)
                loops = max(loops, within + (item.type.arity is not Arity.SCALAR))
        return levels, loops

    @cached_per_name
    def inline_size(self, name: str) -> int:
        """Return the leaves of a message after flattening; a nested message that is called counts as one."""
        total = 0
        for item in self.message(name).fields:
            is_inline = item.type.is_message and not self.is_outlined(item.type.base)
            total += self.inline_size(item.type.base) if is_inline else 1
        return max(1, total)

    @cached_per_name
    def is_fixed(self, name: str) -> bool:
        """Return True if every message of the type has the same shape."""
        return all(
            has_fixed_size(item.type) and (not item.type.is_message or self.is_fixed(item.type.base))
            for item in self.message(name).fields
        )

    @cached_per_name
    def has_structured_arrays(self, name: str) -> bool:
        """Return True if a message contains sequences or arrays of fixed-size messages, at any depth."""
        return any(
            (item.type.arity is not Arity.SCALAR and self.is_fixed(item.type.base))
            or self.has_structured_arrays(item.type.base)
            for item in self.message(name).fields
            if item.type.is_message
        )
