"""Layout rules of CDR as ROS 2 writes it (XCDR1): each size, alignment and prefix is defined here and nowhere else.

The code generator, the field walk, structured arrays, tables and the discovery message of DDS compute positions with
these constants and functions. A position counts from the alignment origin, the byte after the encapsulation header;
an offset counts from the start of the data, header included.

Two consequences of the rules that all of them use:

- A primitive is aligned to its own size; a message has no alignment of its own, so it begins wherever the previous
  value ended, and its first member adds the padding.
- A message whose size does not depend on values contains a member of its largest alignment. Its end is therefore known
  modulo that alignment wherever it begins, so in a sequence all elements after the first are equally long
  (`structured_arrays.sequence_end_offset`).

Source: docs/internals/protocol.md 2.1 for the header, 2.2 for values, 2.4 for padding at the end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeVar

from rosidl_py_gen.base.fieldtype import FieldType

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Position = TypeVar("Position", int, "NDArray[np.int64]")

NUL = b"\0"
"""Terminator byte of a string, which counts in the string's length prefix. A wstring has no terminator."""
EMPTY_MESSAGE = b"\0"
"""Bytes that CDR writes for a message without fields."""


class Count:
    """Length prefix of a sequence, string or wstring."""

    SIZE = 4
    """Size and alignment in bytes."""
    CODE = "I"
    """Struct code."""
    MAX = 0xFFFFFFFF
    """Maximum number of elements, or of bytes or units of a string."""


class WStringUnit:
    """UTF-16 code unit of a wstring, which travels as a u32."""

    SIZE = 4
    """Size and alignment in bytes."""
    MAX = 0xFFFF
    """Largest unit; a larger number is not valid UTF-16."""


class Alignment:
    """Alignment of values, and the padding before them."""

    MAX = 8
    """Largest alignment of any value in CDR; positions that are equal modulo 8 are laid out alike."""
    NETWORK = 4
    """Number of which the length of a sample on the network is a multiple; zeros are appended to shorter messages."""
    PADDING: Final = {align: tuple(bytes(-position % align) for position in range(align)) for align in (1, 2, 4, 8)}
    """Padding bytes before a value, by the alignment of the value, then by ``position & align - 1``."""

    @staticmethod
    def up(position: Position, align: int) -> Position:
        """Return the first multiple of `align`, a power of two, at or after a position.

        The positions of an array are aligned one by one.
        """
        return position + (-position & align - 1)

    @staticmethod
    def of_element(kind: FieldType) -> int:
        """Return the alignment of an element of a field: the size of a primitive, or of a string's length prefix."""
        return Count.SIZE if kind.primitive is None else kind.primitive.size


class Header:
    """Encapsulation header of little-endian data."""

    BYTES = b"\x00\x01\x00\x00"
    """The header. Bit 0 of its second byte is the byte order; the last two bytes are options."""
    SIZE = 4
    VALUE = 0x0100
    """Value of the first two bytes as a little-endian `H`."""

    @staticmethod
    def align(offset: Position, align: int) -> Position:
        """Return the first aligned offset at or after an offset into CDR data.

        Alignment counts from the end of the header, offsets count from its start.
        """
        return offset + (Header.SIZE - offset & align - 1)


def min_element_size(kind: FieldType) -> int:
    """Return the minimum bytes of an element of a field without padding; every message has at least one byte."""
    return len(EMPTY_MESSAGE) if kind.is_message else Alignment.of_element(kind)
