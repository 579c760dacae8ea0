"""The layout plan of a message: what is written in which order, and what is known of alignment.

`layout` builds it, the views for encode and decode and the `plan` command read it. Objects (the message itself, nested
messages, loop elements) are numbered; a `Ref` is an attribute of one of them. Object 0 is the message.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple, NoReturn

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType


class Ref(NamedTuple):
    """The attribute `name` of object `owner`; `path` is how a user writes it."""

    owner: int
    name: str
    path: str


class Scalar(NamedTuple):
    """A primitive inside a run."""

    ref: Ref
    code: str
    offset: int


class FixedNumberArray(NamedTuple):
    """A fixed numeric array inside a run: bytes when packed, a view at `offset` of the run when read."""

    ref: Ref
    code: str
    length: int
    offset: int


class LengthPrefix(NamedTuple):
    """The u32 in front of a string or sequence; `ref` is the field whose content follows the run."""

    ref: Ref
    offset: int


class EmptyMessageByte(NamedTuple):
    """The one byte of an empty message."""

    offset: int


Item = Scalar | FixedNumberArray | LengthPrefix | EmptyMessageByte


class AlignmentState(NamedTuple):
    """What is known of the position where a step begins, counted from the alignment origin.

    Attributes:
        static: the exact offset, when everything before has a fixed size.
        modulus: position = remainder (mod modulus); 1 means nothing is known.
        remainder: see modulus.
    """

    static: int | None
    modulus: int
    remainder: int


class InlineMessage(NamedTuple):
    """A nested message is written in line from here on as object `number`; `empty`: it has no fields."""

    ref: Ref
    type: str
    number: int
    empty: bool


class PackedRun(NamedTuple):
    """Fixed-size values packed by one struct call.

    Attributes:
        items: in wire order; offsets count from the first byte behind `nul` and alignment.
        pack: struct code, without byte order, with all inner padding; blocks are bytes.
        unpack: the same with blocks as padding.
        size: bytes behind `nul` and alignment.
        align: boundary the run begins at when that is not known statically, else 1 (known padding is in the code).
        nul: the terminator of the string before is written with this run.
        start: where it begins, before `nul` when encoding.
    """

    items: tuple[Item, ...]
    pack: str
    unpack: str
    size: int
    align: int
    nul: bool
    start: AlignmentState


class StringContent(NamedTuple):
    """The characters of a string; its count is in a run before, its NUL in the run behind or in a
    `StringTerminator`.
    """

    ref: Ref
    type: FieldType
    start: AlignmentState


class StringTerminator(NamedTuple):
    """The terminator of a string that no run follows."""

    start: AlignmentState


class NumberArray(NamedTuple):
    """The elements of a numeric sequence, or of a fixed array too large for a run.

    Attributes:
        pad: known padding before the elements, only present when there are any.
        align: boundary when the padding is not known, else 1.
    """

    ref: Ref
    type: FieldType
    code: str
    item_size: int
    pad: int
    align: int
    start: AlignmentState


class StringArray(NamedTuple):
    """The elements of a sequence or array of strings."""

    ref: Ref
    type: FieldType
    pad: int
    align: int
    start: AlignmentState


class LoopMode(Enum):
    """How the elements of a sequence of messages are handled."""

    PACKED = "packed"  # every element is the same run at a fixed stride
    INLINE = "inline"  # the element's steps are printed in the loop
    CALL = "call"  # the element's class is called


class Loop(NamedTuple):
    """The elements of a sequence or array of messages; `number` is the element as an object.

    Attributes:
        body: steps of one element; for PACKED exactly `InlineMessage`s and one `PackedRun`.
        stride: bytes of one element when PACKED, else 0.
        least: the fewest bytes an element can take; what a count is checked against.
        pad, align: before the first element, only when there is one (PACKED); else 0 and 1.
        fixed: elements are of fixed size, so a structured array may stand for the list.
        records: inside an element there are such sequences or arrays.
    """

    ref: Ref
    type: FieldType
    number: int
    mode: LoopMode
    body: tuple[LayoutStep, ...]
    stride: int
    least: int
    pad: int
    align: int
    start: AlignmentState
    fixed: bool
    structured_arrays: bool


class NestedCall(NamedTuple):
    """A nested message that is too large to write in line: its class is called; `structured_arrays` as in `Loop`."""

    ref: Ref
    type: str
    start: AlignmentState
    structured_arrays: bool


LayoutStep = (
    InlineMessage | PackedRun | StringContent | StringTerminator | NumberArray | StringArray | Loop | NestedCall
)


class LayoutPlan(NamedTuple):
    """How one message class is written and read.

    Attributes:
        name: full ROS name.
        steps: in wire order.
        heavy: too large to be written in line by others, so it has `_write` and `_read` of its own.
        records: there are sequences or arrays of fixed-size messages at some depth, which decoders can leave as arrays.
    """

    name: str
    steps: tuple[LayoutStep, ...]
    outlined: bool
    structured_arrays: bool


def assert_never(value: NoReturn) -> NoReturn:
    """Close a `match` over steps or items; typing.assert_never is younger than Python 3.10."""
    raise AssertionError(f"unexpected {value!r}")
