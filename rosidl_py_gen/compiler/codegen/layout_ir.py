"""Layout plan of a message: steps in wire order, and what is known of the alignment.

The planner builds the plan, encoder and decoder emit code from it. Objects (the message itself, nested messages, loop
elements) are numbered; a `Ref` is an attribute of one of them. Object 0 is the message.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple, NoReturn

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType


class Ref(NamedTuple):
    """Attribute `name` of the message object with the number `owner`; `path` is the field path in error messages."""

    owner: int
    name: str
    path: str


class Scalar(NamedTuple):
    """Primitive value inside a packed run."""

    ref: Ref
    code: str
    offset: int


class FixedNumberArray(NamedTuple):
    """Fixed numeric array inside a packed run: packed as bytes, decoded as a view at `offset` of the run."""

    ref: Ref
    code: str
    length: int
    offset: int


class LengthPrefix(NamedTuple):
    """Length (uint32) before a string or sequence; `ref` is the field whose content follows the run."""

    ref: Ref
    offset: int


class EmptyMessageByte(NamedTuple):
    """The single byte that CDR writes for a message without fields."""

    offset: int


Item = Scalar | FixedNumberArray | LengthPrefix | EmptyMessageByte


class AlignmentState(NamedTuple):
    """Knowledge about the position of a step, counted from the alignment origin.

    Attributes:
        static: the exact offset if all preceding steps have a fixed size, else None.
        modulus, remainder: position = remainder (mod modulus); modulus 1 if nothing is known.
    """

    static: int | None
    modulus: int
    remainder: int


class InlineMessage(NamedTuple):
    """Start of a nested message that is encoded inline as object `number`; `empty` means that it has no fields."""

    ref: Ref
    type: str
    number: int
    empty: bool


class PackedRun(NamedTuple):
    """Fixed-size values packed by one struct call.

    Attributes:
        items: in wire order; offsets count from the first byte after `nul` and alignment.
        pack: struct code, without byte order, with all inner padding; fixed arrays are bytes.
        unpack: struct code in which fixed arrays are padding.
        size: bytes after `nul` and alignment.
        align: alignment of the run if its padding is not known statically, else 1 (known padding is in the code).
        nul: the terminator of the preceding string is written with this run.
        start: position of the run, before `nul` when encoding.
    """

    items: tuple[Item, ...]
    pack: str
    unpack: str
    size: int
    align: int
    nul: bool
    start: AlignmentState


class StringContent(NamedTuple):
    """Characters of a string. The preceding run has the length, the next run or a `StringTerminator` the NUL."""

    ref: Ref
    type: FieldType
    start: AlignmentState


class StringTerminator(NamedTuple):
    """NUL of a string after which no packed run follows."""

    start: AlignmentState


class NumberArray(NamedTuple):
    """Elements of a numeric sequence, or of a fixed array too large for a run.

    Attributes:
        pad: padding in bytes if known; it exists only before elements.
        align: alignment of the elements if the padding is not known, else 1.
    """

    ref: Ref
    type: FieldType
    code: str
    item_size: int
    pad: int
    align: int
    start: AlignmentState


class StringArray(NamedTuple):
    """Elements of a sequence or array of strings; `pad` and `align` are as in `NumberArray`."""

    ref: Ref
    type: FieldType
    pad: int
    align: int
    start: AlignmentState


class LoopMode(Enum):
    """Kinds of generated code for the elements of a sequence of messages."""

    PACKED = "packed"  # every element is the same run at a fixed stride
    INLINE = "inline"  # the element's steps are emitted in the loop
    CALL = "call"  # the element's class is called


class Loop(NamedTuple):
    """Elements of a sequence or array of messages; `number` is the object number of the current element.

    Attributes:
        body: steps of one element; for PACKED only `InlineMessage` and one `PackedRun`.
        stride: bytes of one element if PACKED, else 0.
        min_size: minimum bytes of an element, by which a count is checked.
        pad, align: as in `NumberArray` if PACKED, else 0 and 1.
        fixed: elements are of fixed size, so a structured array can replace the list.
        structured_arrays: an element contains sequences or arrays of fixed-size messages.
    """

    ref: Ref
    type: FieldType
    number: int
    mode: LoopMode
    body: tuple[LayoutStep, ...]
    stride: int
    min_size: int
    pad: int
    align: int
    start: AlignmentState
    fixed: bool
    structured_arrays: bool


class NestedCall(NamedTuple):
    """Nested message that is too large to emit inline: the generated code calls the codec of its class.

    Attributes:
        structured_arrays: the message contains sequences or arrays of fixed-size messages.
    """

    ref: Ref
    type: str
    start: AlignmentState
    structured_arrays: bool


LayoutStep = (
    InlineMessage | PackedRun | StringContent | StringTerminator | NumberArray | StringArray | Loop | NestedCall
)


class LayoutPlan(NamedTuple):
    """Steps that encode and decode one message class.

    Attributes:
        name: full ROS name.
        steps: in wire order.
        outlined: too large to be emitted inline in other messages, so it has `_write` and `_read`.
        structured_arrays: sequences or arrays of fixed-size messages exist at some depth; decoders can return them as
            structured arrays.
    """

    name: str
    steps: tuple[LayoutStep, ...]
    outlined: bool
    structured_arrays: bool


def assert_never(value: NoReturn) -> NoReturn:
    """Raise `AssertionError` for a step or item that a `match` has no case for (Python 3.10 has no `assert_never`)."""
    raise AssertionError(f"unexpected {value!r}")
