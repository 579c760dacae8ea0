"""Size of generated code: which messages are emitted inline, which are called, and which have no codec of their own.

Generated code stays in proportion to the definition: its size is that of the leaves, the fields of a message after
nested messages are flattened.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.layout import has_fixed_size

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import MessageDef

# A nested message of more leaves than this is called, not printed in line. It bounds the generated code to a multiple
# of the definition; every common message (Odometry has 22 leaves, Marker 43) stays flat.
MAX_INLINE_FIELDS = 48
# So is one with more levels or loops in each other: CPython takes 20 loops, and each is planned up to four times.
MAX_INLINE_DEPTH = 12
MAX_INLINE_LOOPS = 5
# A message of more leaves than this has no generated codec at all, but `cdr.wide.WideMessage`: CPython takes 40 kB to
# compile what encodes and decodes one string. Messages of public packages have up to 70 fields.
WIDE_WEIGHT = 500


class Weights:
    """Facts of messages by name, each found once.

    Args:
        lookup: gives the definition of a message.
        max_leaves: leaves of all messages together that get a codec of their own; all others are wide.
    """

    def __init__(self, lookup: Callable[[str], MessageDef | None], max_leaves: float) -> None:
        self._lookup = lookup
        self._leaves_left = max_leaves
        self._weights: dict[str, int] = {}
        self._heights: dict[str, tuple[int, int]] = {}
        self._wide: dict[str, bool] = {}
        self._fixed: dict[str, bool] = {}
        self._records: dict[str, bool] = {}

    def message(self, name: str) -> MessageDef:
        found = self._lookup(name)
        assert found is not None, name  # references were checked before
        return found

    def is_outlined(self, name: str) -> bool:
        levels, loops = self.nesting_depth(name)
        return self.inline_size(name) > MAX_INLINE_FIELDS or levels > MAX_INLINE_DEPTH or loops > MAX_INLINE_LOOPS

    def is_wide(self, name: str) -> bool:
        """Return True if a codec of its own would be out of proportion to the definition."""
        if name not in self._wide:
            weight = self.inline_size(name)
            self._wide[name] = weight > min(WIDE_WEIGHT, self._leaves_left)
            self._leaves_left -= 0 if self._wide[name] else weight
        return self._wide[name]

    def nesting_depth(self, name: str) -> tuple[int, int]:
        """Return the levels of nested messages, and of loops over them, that are emitted inline in a message."""
        if name not in self._heights:
            levels = loops = 0
            for item in self.message(name).fields:
                if item.type.is_message:
                    below, within = (0, 0) if self.is_outlined(item.type.base) else self.nesting_depth(item.type.base)
                    levels = max(levels, below + 1)
                    loops = max(loops, within + (item.type.arity is not Arity.SCALAR))
            self._heights[name] = levels, loops
        return self._heights[name]

    def inline_size(self, name: str) -> int:
        """Leaves of a message after flattening; a nested message that is called counts as one."""
        if name not in self._weights:
            total = 0
            for item in self.message(name).fields:
                is_inline = item.type.is_message and not self.is_outlined(item.type.base)
                total += self.inline_size(item.type.base) if is_inline else 1
            self._weights[name] = max(1, total)
        return self._weights[name]

    def is_fixed(self, name: str) -> bool:
        """Return True if every message of the type has the same shape."""
        if name not in self._fixed:
            self._fixed[name] = all(
                has_fixed_size(item.type) and (not item.type.is_message or self.is_fixed(item.type.base))
                for item in self.message(name).fields
            )
        return self._fixed[name]

    def has_records(self, name: str) -> bool:
        """Return True if a message contains sequences or arrays of fixed-size messages, at any depth."""
        if name not in self._records:
            self._records[name] = any(
                (item.type.arity is not Arity.SCALAR and self.is_fixed(item.type.base))
                or self.has_records(item.type.base)
                for item in self.message(name).fields
                if item.type.is_message
            )
        return self._records[name]
