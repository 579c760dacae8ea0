"""Limits on the size of interface types.

A definition is untrusted, and a few hundred bytes can define a type of any size: by types that contain the next one
twice, by fixed arrays, or by thousands of fields. The limits bound the time and memory of the compiler, the generated
code, and the memory of a new message.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.cdr.layout import fixed_count, has_count

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import Diagnostics, Interface, Location, MessageDef

MAX_LEVELS = 100
"""Maximum depth of types nested in a type."""
MAX_ELEMENTS = 2000
"""Maximum elements of a definition: fields, constants and values of default arrays of all its messages. A nested
message of few fields adds its fields, as they are emitted inline. CPython compiles the generated code of a definition
at once, and takes up to 90 kB and 1 ms for each element: at most 200 MB and 2 s. The largest definition found in public
packages has 898 elements, etsi_its_denm_ts_msgs/msg/LocationContainer."""
MAX_FIELDS = 10_000
"""Maximum fields of a type and all types that it refers to, each type counted once. A nested message of few fields
counts with its fields. The generated code takes up to 6 kB for each field while the process runs. The largest type
found in public packages has 2928 fields, apollo_msgs/msg/Apollov2xCarStatus."""
MAX_TYPES = 500
"""Maximum types that a type refers to, at all levels: hashing takes quadratic time, as the hash of each type covers all
types that it refers to."""
MAX_VALUES = 1 << 20
"""Maximum fields and elements of fixed arrays of strings and messages in a new message, which takes 0.5 s to create."""
MAX_BYTES = 1 << 28
"""Maximum bytes of all fixed arrays of numbers in a new message."""

_MAX_INLINE_FIELDS = 48
"""Maximum fields of a nested message that counts with its fields, not as one: at least
`layout_plan.MAX_INLINE_FIELDS`."""


class _TypeSize(NamedTuple):
    """Size of a type for the size limits, as it counts in the types that contain this type."""

    values: int
    size: int
    inline_fields: int
    inline_elements: int
    elements: int
    types: frozenset[str]


_ELEMENTS = "fields (with the fields of nested messages), constants and default values"
_ELEMENTS_CURE = "; split it into several messages, or use arrays"
_UNKNOWN = _TypeSize(1, 1, 1, 0, 0, frozenset())
"""Size that is assumed for a type that does not exist or is too large; such a type has a diagnostic already."""


class SizeChecker:
    """Checker of type sizes; a type must be checked after the types that it refers to."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self._diagnostics = diagnostics
        self._sizes: dict[str, _TypeSize] = {}

    def check(self, message: MessageDef) -> None:
        """Compute the size of a message.

        If it exceeds a limit, add a diagnostic at the field or constant where it does.
        """
        values = size = inline_fields = other_fields = inline_elements = 0
        elements = len(message.constants)
        types: set[str] = set()
        self._sizes[str(message.name)] = _UNKNOWN
        if elements > MAX_ELEMENTS:
            place = message.constants[MAX_ELEMENTS].location
            self._report(place, f"{message.name} has {elements} {_ELEMENTS}", MAX_ELEMENTS, _ELEMENTS_CURE)
            return
        for item in message.fields:
            below = self._sizes.get(item.type.base, _UNKNOWN) if item.type.is_message else _UNKNOWN
            count = 0 if has_count(item.type) else fixed_count(item.type)
            values += 1 + (0 if item.type.primitive else count * below.values)
            size += count * (item.type.primitive.size if item.type.primitive else below.size)
            is_inline = below.inline_fields <= _MAX_INLINE_FIELDS
            inline_fields += below.inline_fields if is_inline else 1
            emitted = 1 + (below.inline_elements if is_inline else 0)
            inline_elements += emitted
            elements += emitted + (len(item.default) if isinstance(item.default, tuple) else 0)
            if item.type.is_message and item.type.base not in types:
                new = (below.types | {item.type.base}) - types
                other_fields += sum(self._sizes.get(name, _UNKNOWN).inline_fields for name in new)
                types |= new
            for found, maximum, text, cure in (
                (values, MAX_VALUES, "values in nested messages and fixed arrays", ""),
                (size, MAX_BYTES, "bytes in fixed arrays", ""),
                (elements, MAX_ELEMENTS, _ELEMENTS, _ELEMENTS_CURE),
                (inline_fields + other_fields, MAX_FIELDS, "fields with the fields of nested messages", ""),
                (len(types), MAX_TYPES, "types that it refers to", ""),
            ):
                if found > maximum:
                    self._report(item.location, f"{message.name} has {found} {text} up to here", maximum, cure)
                    return
        sizes = max(1, values), max(1, size), max(1, inline_fields)
        self._sizes[str(message.name)] = _TypeSize(*sizes, inline_elements, elements, frozenset(types))

    def check_interface(self, interface: Interface) -> None:
        """Add a diagnostic if the checked messages of an interface are together too large for one module."""
        elements = 0
        for message in interface.messages:
            elements += self._sizes[str(message.name)].elements
            if elements > MAX_ELEMENTS:
                place = message.fields[0].location if message.fields else message.constants[0].location
                found = f"{interface.name} has {elements} {_ELEMENTS} up to and including {message.name.name}"
                self._report(place, found, MAX_ELEMENTS, _ELEMENTS_CURE)
                return

    def _report(self, location: Location, found: str, maximum: int, cure: str) -> None:
        self._diagnostics.add(location, f"{found}, at most {maximum} are allowed{cure}")
