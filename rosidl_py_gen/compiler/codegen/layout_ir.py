"""Data structures of the layout plan of a message: encoding steps in the order of the CDR data, with what is known of
the alignment.

The planner builds the plan; the emitters of encoder and decoder generate code from it. Objects (the message itself,
nested messages, loop elements) are numbered; a `Ref` is an attribute of one of them. Object 0 is the message.
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
    """Primitive value that is packed together with its neighbours by one struct call."""

    ref: Ref
    code: str
    offset: int


class FixedNumberArray(NamedTuple):
    """Fixed numeric array that is packed by the same struct call as its neighbours, as bytes.

    The decoder returns an array that shares the memory at `offset` of the packed values.
    """

    ref: Ref
    code: str
    length: int
    offset: int


class LengthPrefix(NamedTuple):
    """Length (uint32) before a string or sequence; `ref` is the field whose content follows the packed values."""

    ref: Ref
    offset: int


class EmptyMessageByte(NamedTuple):
    """The single byte that CDR writes for a message without fields."""

    offset: int


Item = Scalar | FixedNumberArray | LengthPrefix | EmptyMessageByte


class AlignmentState(NamedTuple):
    """Knowledge at generation time about a position in the encoded message, counted from the origin of CDR alignment.

    Attributes:
        static: the exact offset if everything before it has a fixed size, else None.
        modulus, remainder: position = remainder (mod modulus); modulus 1 if nothing is known.
    """

    static: int | None
    modulus: int
    remainder: int


class InlineMessage(NamedTuple):
    """Start of a nested message whose code is generated inline, as object `number`.

    `empty` means that the message has no fields.
    """

    ref: Ref
    type: str
    number: int
    empty: bool


class PackedRun(NamedTuple):
    """Consecutive fixed-size values that one struct call packs or unpacks.

    Attributes:
        items: the values in the order of the data; offsets count from the first byte after `nul` and alignment.
        pack: struct code, without byte order, with all inner padding; fixed arrays are bytes.
        unpack: struct code in which fixed arrays are padding.
        size: bytes after `nul` and alignment.
        align: alignment of the values if the padding before them is not known at generation time, else 1 (known padding
            is in the code).
        nul: True if the terminating zero byte of the preceding string is written by the same call, before the values.
        start: what is known of the position of the first byte that the call reads, or writes (then with the zero byte).
    """

    items: tuple[Item, ...]
    pack: str
    unpack: str
    size: int
    align: int
    nul: bool
    start: AlignmentState


class StringContent(NamedTuple):
    """Characters of a string in a layout plan.

    The length precedes them in a `PackedRun`; the NUL is in the next `PackedRun`, or a `StringTerminator`.
    """

    ref: Ref
    type: FieldType
    start: AlignmentState


class StringTerminator(NamedTuple):
    """NUL of a string that no packed values follow, so the NUL is written separately."""

    start: AlignmentState


class NumberArray(NamedTuple):
    """Elements of a numeric sequence, or of a fixed array that is too large to be packed with its neighbours.

    Attributes:
        pad: padding in bytes if known at generation time; the padding exists only before elements.
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
    """Elements of a sequence or array of strings in a layout plan.

    Attributes:
        pad: padding in bytes if known at generation time; the padding exists only before elements.
        align: alignment of the elements if the padding is not known, else 1.
    """

    ref: Ref
    type: FieldType
    pad: int
    align: int
    start: AlignmentState


class LoopMode(Enum):
    """Ways in which code for the elements of a sequence of messages is generated."""

    PACKED = "packed"  # every element is the same run at a fixed stride
    INLINE = "inline"  # the element's steps are emitted in the loop
    CALL = "call"  # the element's class is called


class Loop(NamedTuple):
    """Elements of a sequence or array of messages in a layout plan.

    `number` is the object number of the current element.

    Attributes:
        body: steps of one element; for PACKED only `InlineMessage` and one `PackedRun`.
        stride: bytes of one element if PACKED, else 0.
        min_size: minimum bytes of an element, by which the decoder checks a stated count.
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
    """Nested message that is too large for inline code: the generated code calls encoder and decoder of its class.

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
    """Layout plan: the steps that encode and decode one message class.

    Attributes:
        name: full ROS name.
        steps: in the order of the CDR data.
        outlined: the message is too large for inline code in other messages, so it has the methods `_write` and
            `_read`.
        structured_arrays: sequences or arrays of fixed-size messages exist at some depth; decoders can return them as
            structured arrays.
    """

    name: str
    steps: tuple[LayoutStep, ...]
    outlined: bool
    structured_arrays: bool


def assert_never(value: NoReturn) -> NoReturn:
    """Raise `AssertionError` for a value that no case of a `match` statement handles (Python 3.10 has no
    `typing.assert_never`).
    """
    raise AssertionError(f"unexpected {value!r}")
