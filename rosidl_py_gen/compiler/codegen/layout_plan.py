"""Layout plan of a message: encoding steps in the order of the CDR data, with what is known of the alignment.

The planner builds the plan, and decides whether code for a nested message is inline or a call. The rules of CDR are in
`cdr/layout.py`; the planner applies them to fields. Encoder and decoder emit code for the planned steps and never count
bytes. The size of generated code is proportional to the number of leaves, the fields of a message and of all its nested
messages.

Objects (the message itself, nested messages, loop elements) are numbered; a `Ref` is an attribute of one of them.
Object 0 is the message.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from functools import wraps
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypeVar

from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity, FieldType
from rosidl_py_gen.base.names import py_name
from rosidl_py_gen.cdr.layout import EMPTY_MESSAGE, NUL, Alignment, Count, WStringUnit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.compiler.frontend.model import MessageDef


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


MAX_INLINE_FIELDS = 48
"""Maximum leaves (flattened fields) of a nested message that is emitted inline. The maximum bounds the generated code
to a multiple of the definition; every common message (Odometry has 22 leaves, Marker 43) is emitted inline."""
MAX_INLINE_DEPTH = 12
MAX_INLINE_LOOPS = 5
"""Maximum depth of nested loops in generated code: CPython accepts 20, and the planner may plan each loop four times.
"""
BLOCK_BYTES = 1024
"""Maximum bytes of a fixed array that one struct call packs with its neighbours. A larger array is a separate segment,
which saves a copy."""
_CODES = {base: primitive.code for base, primitive in PRIMITIVES.items()}
_RCLPY_CODES = {**_CODES, "byte": "c"}
"""Struct codes by primitive type for classes of rclpy's API, in which a byte is a bytes object of length 1."""

_Result = TypeVar("_Result")


def _cached_per_name(method: Callable[[LayoutPlanner, str], _Result]) -> Callable[[LayoutPlanner, str], _Result]:
    """Decorate a method so that its results are cached by message name."""

    @wraps(method)
    def cached(self: LayoutPlanner, name: str) -> _Result:
        results = self.results.setdefault(method.__name__, {})
        if name not in results:
            results[name] = method(self, name)
        result: _Result = results[name]
        return result

    return cached


class LayoutPlanner:
    """Factory of layout plans by message name, which also decides how code is generated for each message.

    Args:
        lookup: returns the definition of a message by full name, or None.
        rclpy: plan for classes of rclpy's API, in which `byte` is bytes of length 1.
    """

    def __init__(self, lookup: Callable[[str], MessageDef | None], *, rclpy: bool = False) -> None:
        self._lookup = lookup
        self.rclpy, self.codes = rclpy, _RCLPY_CODES if rclpy else _CODES
        self.results: dict[str, dict[str, Any]] = {}

    def message(self, name: str) -> MessageDef:
        """Return the definition of a message by its full name; the message must exist."""
        message = self._lookup(name)
        assert message is not None, name  # references were checked before
        return message

    def is_outlined(self, name: str) -> bool:
        """Return True if generated code of other messages calls the encoder and decoder of this message, because it is
        too large for inline code.
        """
        levels, loops = self.nesting_depth(name)
        return self.inline_size(name) > MAX_INLINE_FIELDS or levels > MAX_INLINE_DEPTH or loops > MAX_INLINE_LOOPS

    @_cached_per_name
    def nesting_depth(self, name: str) -> tuple[int, int]:
        """Return how deep messages are nested in a message's generated code, and how deep its loops over messages are
        nested.
        """
        levels = loops = 0
        for item in self.message(name).fields:
            if item.type.is_message:
                below, within = (0, 0) if self.is_outlined(item.type.base) else self.nesting_depth(item.type.base)
                levels = max(levels, below + 1)
                loops = max(loops, within + (item.type.arity is not Arity.SCALAR))
        return levels, loops

    @_cached_per_name
    def inline_size(self, name: str) -> int:
        """Return the number of fields of a message, with the fields of its nested messages.

        A nested message whose encoder is called, not inlined, counts as one field.
        """
        total = 0
        for item in self.message(name).fields:
            is_inline = item.type.is_message and not self.is_outlined(item.type.base)
            total += self.inline_size(item.type.base) if is_inline else 1
        return max(1, total)

    @_cached_per_name
    def is_fixed(self, name: str) -> bool:
        """Return True if all messages of a type have the same encoded size."""
        return all(
            item.type.has_fixed_size and (not item.type.is_message or self.is_fixed(item.type.base))
            for item in self.message(name).fields
        )

    @_cached_per_name
    def has_structured_arrays(self, name: str) -> bool:
        """Return True if a message contains sequences or arrays of fixed-size messages, at any depth."""
        return any(
            (item.type.arity is not Arity.SCALAR and self.is_fixed(item.type.base))
            or self.has_structured_arrays(item.type.base)
            for item in self.message(name).fields
            if item.type.is_message
        )

    @_cached_per_name
    def plan(self, name: str) -> LayoutPlan:
        """Return the layout plan of a message; all types that it refers to must exist."""
        is_outlined = self.is_outlined(name)
        # An outlined message is called at any position, so nothing is known of its start; others start at offset 0.
        builder = _PlanBuilder(self, AlignmentState(None, 1, 0) if is_outlined else AlignmentState(0, Alignment.MAX, 0))
        builder.message(name, 0, "")
        builder.close()
        return LayoutPlan(name, tuple(builder.steps), is_outlined, self.has_structured_arrays(name))

    @_cached_per_name
    def min_size(self, name: str) -> int:
        """Return a lower bound for the encoded size of a message in bytes, in which padding is not counted."""
        total = 0
        for kind in (item.type for item in self.message(name).fields):
            if kind.is_sequence:
                total += Count.SIZE
            else:
                element = self.min_size(kind.base) if kind.is_message else Alignment.of_element(kind)  # also its size
                total += element * kind.fixed_count
        return max(len(EMPTY_MESSAGE), total)


@dataclass(slots=True)
class _OpenRun:
    """Packed values under construction: the planner appends consecutive fixed-size values, which one struct call will
    pack.
    """

    start: AlignmentState
    nul: bool
    items: list[Item] = field(default_factory=list)
    pack: list[tuple[str, int]] = field(default_factory=list)  # code and repetitions; padding has code x
    unpack: list[tuple[str, int]] = field(default_factory=list)
    size: int = 0
    align: int = 1

    def append(self, code: str, count: int, read: str = "") -> None:
        for codes, letter in ((self.pack, code), (self.unpack, read or code)):
            if codes and codes[-1][0] == letter and letter != "s":
                codes[-1] = (letter, codes[-1][1] + count)
            else:
                codes.append((letter, count))


def _struct_code(codes: list[tuple[str, int]]) -> str:
    return "".join(letter if count == 1 else f"{count}{letter}" for letter, count in codes)


def _known_modulus(kind: FieldType) -> int:
    """Return a number of which the position after a string, or after a sequence of primitives, is known to be a
    multiple.

    A string may end anywhere. An empty sequence ends after its length prefix, without the padding of an element.
    """
    if kind.is_string:
        return WStringUnit.SIZE if kind.base == "wstring" else 1
    assert kind.primitive is not None
    return min(kind.primitive.size, Count.SIZE)


class _PlanBuilder:
    """Builder of the layout steps for the fields of a message, in one pass.

    `now` is what is known about the current position.
    """

    def __init__(self, planner: LayoutPlanner, start: AlignmentState, first_object: int = 1) -> None:
        self.planner = planner
        # Either an absolute offset, or position = remainder (mod modulus).
        self.now = start
        self.steps: list[LayoutStep] = []
        self.run: _OpenRun | None = None
        self.nul = False  # the terminator of a string is pending
        self.next_object = first_object

    # --- position -------------------------------------------------------------------------------------------------

    def _advance(self, size: int) -> None:
        now = self.now
        static = None if now.static is None else now.static + size
        self.now = AlignmentState(static, now.modulus, (now.remainder + size) % now.modulus)

    def _known_padding(self, align: int) -> int | None:
        """Return the padding in bytes from the current position to a multiple of `align`.

        Returns None if it depends on the values of the message.
        """
        return -self.now.remainder % align if self.now.modulus % align == 0 else None

    def _lose_offset(self, modulus: int) -> None:
        """Record that after content of variable size the position is only known to be a multiple of `modulus`."""
        self.now = AlignmentState(None, modulus, 0)

    # --- runs -----------------------------------------------------------------------------------------------------

    def _append_to_run(self, align: int, size: int, code: str, count: int, read: str = "") -> int:
        """Append a fixed-size value to the values that one struct call packs, and return the value's offset among them.

        If the padding before the value is unknown, the value starts a new struct call.
        """
        gap = self._known_padding(align)
        # A run is one struct, whose padding is a constant: it cannot go on where the padding depends on the message.
        if gap is None and self.run is not None:
            self.end_run()
        if self.run is None:
            # The run also contains the pending terminator of a string, which saves a step.
            self.run = _OpenRun(self.now, self.nul)
            if self.nul:
                self.nul = False
                self._advance(len(NUL))
                gap = self._known_padding(align)
        run = self.run
        if gap is None:  # emitted code aligns before the run; after that the position is a multiple of `align`
            run.align = align
            self.now = AlignmentState(None, align, 0)
        elif gap:
            run.append("x", gap)
            run.size += gap
            self._advance(gap)
        offset = run.size
        run.append(code, count, read)
        run.size += size
        self._advance(size)
        return offset

    def end_run(self) -> None:
        run, self.run = self.run, None
        if run is not None:
            codes = _struct_code(run.pack), _struct_code(run.unpack)
            self.steps.append(PackedRun(tuple(run.items), *codes, run.size, run.align, run.nul, run.start))

    def close(self) -> None:
        """Finish the current group of packed values, and add the terminator of a string that has none yet."""
        self.end_run()
        if self.nul:
            self.nul = False
            self.steps.append(StringTerminator(self.now))
            self._advance(len(NUL))

    # --- fields ---------------------------------------------------------------------------------------------------

    def message(self, name: str, owner: int, path: str) -> None:
        definition = self.planner.message(name)
        for item in definition.fields:
            spelling = py_name(item.name)
            self.value(Ref(owner, spelling, f"{path}.{item.name}" if path else item.name), item.type)
        if not definition.fields:
            self._items(EmptyMessageByte(self._append_to_run(1, len(EMPTY_MESSAGE), "x", len(EMPTY_MESSAGE))))

    def _items(self, item: Item) -> None:
        assert self.run is not None
        self.run.items.append(item)

    def value(self, ref: Ref, kind: FieldType) -> None:
        if kind.arity is not Arity.SCALAR:
            self._many(ref, kind)
        elif kind.primitive is not None:
            size, code = kind.primitive.size, self.planner.codes[kind.base]
            self._items(Scalar(ref, code, self._append_to_run(size, size, code, 1)))
        elif kind.is_string:
            self._count(ref)
            self.steps.append(StringContent(ref, kind, self.now))
            self._lose_offset(_known_modulus(kind))
            self.nul = kind.base == "string"
        elif self.planner.is_outlined(kind.base):
            self.close()
            self.steps.append(NestedCall(ref, kind.base, self.now, self.planner.has_structured_arrays(kind.base)))
            self._lose_offset(1)
        else:
            # A struct has no alignment of its own: a nested message is laid out at its position, field by field.
            number = self._new_object()
            # Has no bytes, so an open run continues after it. Emitters load or create objects before the run.
            empty = not self.planner.message(kind.base).fields
            self.steps.append(InlineMessage(ref, kind.base, number, empty))
            self.message(kind.base, number, ref.path)

    def _new_object(self) -> int:
        self.next_object += 1
        return self.next_object - 1

    def _count(self, ref: Ref) -> None:
        self._items(LengthPrefix(ref, self._append_to_run(Count.SIZE, Count.SIZE, Count.CODE, 1)))
        self.end_run()

    def _many(self, ref: Ref, kind: FieldType) -> None:
        fixed = kind.arity is Arity.ARRAY
        primitive = kind.primitive
        if primitive is not None and fixed and primitive.size * kind.capacity <= BLOCK_BYTES:
            # Of constant size: the run goes on after it.
            size = primitive.size * kind.capacity
            offset = self._append_to_run(primitive.size, size, "s", size, "x")
            self._items(FixedNumberArray(ref, self.planner.codes[kind.base], kind.capacity, offset))
            return
        if fixed:
            self.close()
        else:
            self._count(ref)
        if primitive is not None:
            self._numbers(ref, kind, self.planner.codes[kind.base], primitive.size)
        elif kind.is_string:
            pad, align = self._padding_before(Alignment.of_element(kind))
            self.steps.append(StringArray(ref, kind, pad, align, self.now))
            self._lose_offset(_known_modulus(kind))
        else:
            self._loop(ref, kind)

    def _padding_before(self, align: int) -> tuple[int, int]:
        gap = self._known_padding(align)
        return (0, align) if gap is None else (gap, 1)

    def _numbers(self, ref: Ref, kind: FieldType, code: str, size: int) -> None:
        pad, align = self._padding_before(size)
        self.steps.append(NumberArray(ref, kind, code, size, pad, align, self.now))
        if kind.arity is Arity.ARRAY:
            if align > 1:
                self.now = AlignmentState(None, size, 0)
            self._advance(pad + size * kind.capacity)
        else:
            self._lose_offset(_known_modulus(kind))

    # --- sequences and arrays of messages -------------------------------------------------------------------------

    def _loop(self, ref: Ref, kind: FieldType) -> None:
        """Append the step for the elements of a sequence or array of messages."""
        number = self._new_object()
        loop = self._packed_loop(ref, kind, number)
        if loop is None and self.planner.is_outlined(kind.base):
            loop = self._make_loop(ref, kind, number, LoopMode.CALL)
            self._lose_offset(1)
        elif loop is None:
            # A loop body must be valid for every iteration: it is planned for the state before the loop, then the state
            # at its end is merged into the entry state, until this does not change. That takes at most four rounds,
            # because the modulus can only become 8, 4, 2 and 1.
            entry = self.now._replace(static=None)
            while True:
                inner = self._element(ref, kind, number, entry)
                inner.close()
                merged = _common_alignment(entry, inner.now)
                if merged == entry:
                    break
                entry = merged
            self.next_object = inner.next_object
            loop = self._make_loop(ref, kind, number, LoopMode.INLINE, inner.steps)
            self.now = entry
        self.steps.append(loop)

    def _make_loop(
        self,
        ref: Ref,
        kind: FieldType,
        number: int,
        mode: LoopMode,
        body: Sequence[LayoutStep] = (),
        stride: int = 0,
        padding: tuple[int, int] = (0, 1),
    ) -> Loop:
        planner, base = self.planner, kind.base
        facts = planner.is_fixed(base), planner.has_structured_arrays(base)
        return Loop(ref, kind, number, mode, tuple(body), stride, planner.min_size(base), *padding, self.now, *facts)

    def _element(self, ref: Ref, kind: FieldType, number: int, entry: AlignmentState) -> _PlanBuilder:
        inner = _PlanBuilder(self.planner, entry, self.next_object)
        inner.message(kind.base, number, f"{ref.path}[]")
        return inner

    def _packed_loop(self, ref: Ref, kind: FieldType, number: int) -> Loop | None:
        """Return a loop that packs all elements with one struct format; None if the elements differ in size
        or padding.
        """
        if not self.planner.is_fixed(kind.base) or self.planner.is_outlined(kind.base):
            return None
        # Candidates for the entry state: the current state, then the alignment of the first primitive after explicit
        # padding.
        entries = [(self.now._replace(static=None), (0, 1))]
        first = self._first_alignment(kind.base)
        if first in (8, 4, 2):
            entries.append((AlignmentState(None, first, 0), self._padding_before(first)))
        for entry, padding in entries:
            inner = self._element(ref, kind, number, entry)
            inner.end_run()
            runs = [step for step in inner.steps if isinstance(step, PackedRun)]
            is_plain = all(isinstance(step, PackedRun | InlineMessage) for step in inner.steps)
            # One stride: a single run without unknown padding, which ends at the remainder where it started.
            if not is_plain or len(runs) != 1 or runs[0].align != 1 or inner.now.remainder != entry.remainder:
                continue
            self.next_object = inner.next_object
            loop = self._make_loop(ref, kind, number, LoopMode.PACKED, inner.steps, runs[0].size, padding)
            if kind.arity is not Arity.ARRAY:  # may be empty: then not even the padding is in the message
                self.now = _common_alignment(self.now, entry)
            else:
                self.now = entry if loop.align > 1 else self.now
                self._advance(loop.pad + loop.stride * kind.capacity)
            return loop
        return None

    def _first_alignment(self, name: str) -> int:
        """Return the alignment of the first primitive of a fixed-size message; 1 if it has none."""
        fields = self.planner.message(name).fields
        if not fields:
            return 1
        kind = fields[0].type
        return self._first_alignment(kind.base) if kind.is_message else Alignment.of_element(kind)


def _common_alignment(left: AlignmentState, right: AlignmentState) -> AlignmentState:
    """Return what two alignment states have in common, for a position that is described by either of them."""
    modulus = min(left.modulus, right.modulus)
    while modulus > 1 and left.remainder % modulus != right.remainder % modulus:
        modulus //= 2
    return AlignmentState(None, modulus, left.remainder % modulus)
