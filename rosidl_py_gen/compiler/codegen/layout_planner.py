"""Planner of the CDR layout of a message, which also decides whether code for a nested message is inline or a call.

The rules of CDR are in `cdr/layout.py`. This module applies them to fields. Encoder and decoder emit code for the
planned steps and never count bytes. The size of generated code is proportional to the number of leaves, the fields of a
message and of all its nested messages.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity, FieldType
from rosidl_py_gen.base.names import py_name
from rosidl_py_gen.cdr.layout import (
    COUNT_BYTES,
    COUNT_CODE,
    EMPTY_MESSAGE,
    MAX_ALIGN,
    NUL,
    element_alignment,
    fixed_count,
    has_count,
    has_fixed_size,
    known_modulus,
    min_element_size,
)
from rosidl_py_gen.compiler.codegen import layout_ir as ir

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.compiler.frontend.model import MessageDef

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
            has_fixed_size(item.type) and (not item.type.is_message or self.is_fixed(item.type.base))
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
    def plan(self, name: str) -> ir.LayoutPlan:
        """Return the layout plan of a message; all types that it refers to must exist."""
        is_outlined = self.is_outlined(name)
        # An outlined message is called at any position, so nothing is known of its start; others start at offset 0.
        builder = _PlanBuilder(
            self, ir.AlignmentState(None, 1, 0) if is_outlined else ir.AlignmentState(0, MAX_ALIGN, 0)
        )
        builder.message(name, 0, "")
        builder.close()
        return ir.LayoutPlan(name, tuple(builder.steps), is_outlined, self.has_structured_arrays(name))

    @_cached_per_name
    def min_size(self, name: str) -> int:
        """Return a lower bound for the encoded size of a message in bytes, in which padding is not counted."""
        total = 0
        for kind in (item.type for item in self.message(name).fields):
            if has_count(kind):
                total += COUNT_BYTES
            else:
                element = self.min_size(kind.base) if kind.is_message else min_element_size(kind)
                total += element * fixed_count(kind)
        return max(len(EMPTY_MESSAGE), total)


@dataclass(slots=True)
class _OpenRun:
    """Packed values under construction: the planner appends consecutive fixed-size values, which one struct call will
    pack.
    """

    start: ir.AlignmentState
    nul: bool
    items: list[ir.Item] = field(default_factory=list)
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


class _PlanBuilder:
    """Builder of the layout steps for the fields of a message, in one pass.

    `now` is what is known about the current position.
    """

    def __init__(self, planner: LayoutPlanner, start: ir.AlignmentState, first_object: int = 1) -> None:
        self.planner = planner
        # Either an absolute offset, or position = remainder (mod modulus).
        self.now = start
        self.steps: list[ir.LayoutStep] = []
        self.run: _OpenRun | None = None
        self.nul = False  # the terminator of a string is pending
        self.next_object = first_object

    # --- position -------------------------------------------------------------------------------------------------

    def _advance(self, size: int) -> None:
        now = self.now
        static = None if now.static is None else now.static + size
        self.now = ir.AlignmentState(static, now.modulus, (now.remainder + size) % now.modulus)

    def _known_padding(self, align: int) -> int | None:
        """Return the padding in bytes from the current position to a multiple of `align`.

        Returns None if it depends on the values of the message.
        """
        return -self.now.remainder % align if self.now.modulus % align == 0 else None

    def _lose_offset(self, modulus: int) -> None:
        """Record that after content of variable size the position is only known to be a multiple of `modulus`."""
        self.now = ir.AlignmentState(None, modulus, 0)

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
            self.now = ir.AlignmentState(None, align, 0)
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
            self.steps.append(ir.PackedRun(tuple(run.items), *codes, run.size, run.align, run.nul, run.start))

    def close(self) -> None:
        """Finish the current group of packed values, and add the terminator of a string that has none yet."""
        self.end_run()
        if self.nul:
            self.nul = False
            self.steps.append(ir.StringTerminator(self.now))
            self._advance(len(NUL))

    # --- fields ---------------------------------------------------------------------------------------------------

    def message(self, name: str, owner: int, path: str) -> None:
        definition = self.planner.message(name)
        for item in definition.fields:
            spelling = py_name(item.name)
            self.value(ir.Ref(owner, spelling, f"{path}.{item.name}" if path else item.name), item.type)
        if not definition.fields:
            self._items(ir.EmptyMessageByte(self._append_to_run(1, len(EMPTY_MESSAGE), "x", len(EMPTY_MESSAGE))))

    def _items(self, item: ir.Item) -> None:
        assert self.run is not None
        self.run.items.append(item)

    def value(self, ref: ir.Ref, kind: FieldType) -> None:
        if kind.arity is not Arity.SCALAR:
            self._many(ref, kind)
        elif kind.primitive is not None:
            size, code = kind.primitive.size, self.planner.codes[kind.base]
            self._items(ir.Scalar(ref, code, self._append_to_run(size, size, code, 1)))
        elif kind.is_string:
            self._count(ref)
            self.steps.append(ir.StringContent(ref, kind, self.now))
            self._lose_offset(known_modulus(kind))
            self.nul = kind.base == "string"
        elif self.planner.is_outlined(kind.base):
            self.close()
            self.steps.append(ir.NestedCall(ref, kind.base, self.now, self.planner.has_structured_arrays(kind.base)))
            self._lose_offset(1)
        else:
            # A struct has no alignment of its own: a nested message is laid out at its position, field by field.
            number = self._new_object()
            # Has no bytes, so an open run continues after it. Emitters load or create objects before the run.
            empty = not self.planner.message(kind.base).fields
            self.steps.append(ir.InlineMessage(ref, kind.base, number, empty))
            self.message(kind.base, number, ref.path)

    def _new_object(self) -> int:
        self.next_object += 1
        return self.next_object - 1

    def _count(self, ref: ir.Ref) -> None:
        self._items(ir.LengthPrefix(ref, self._append_to_run(COUNT_BYTES, COUNT_BYTES, COUNT_CODE, 1)))
        self.end_run()

    def _many(self, ref: ir.Ref, kind: FieldType) -> None:
        fixed = kind.arity is Arity.ARRAY
        primitive = kind.primitive
        if primitive is not None and fixed and primitive.size * kind.capacity <= BLOCK_BYTES:
            # Of constant size: the run goes on after it.
            size = primitive.size * kind.capacity
            offset = self._append_to_run(primitive.size, size, "s", size, "x")
            self._items(ir.FixedNumberArray(ref, self.planner.codes[kind.base], kind.capacity, offset))
            return
        if fixed:
            self.close()
        else:
            self._count(ref)
        if primitive is not None:
            self._numbers(ref, kind, self.planner.codes[kind.base], primitive.size)
        elif kind.is_string:
            pad, align = self._padding_before(element_alignment(kind))
            self.steps.append(ir.StringArray(ref, kind, pad, align, self.now))
            self._lose_offset(known_modulus(kind))
        else:
            self._loop(ref, kind)

    def _padding_before(self, align: int) -> tuple[int, int]:
        gap = self._known_padding(align)
        return (0, align) if gap is None else (gap, 1)

    def _numbers(self, ref: ir.Ref, kind: FieldType, code: str, size: int) -> None:
        pad, align = self._padding_before(size)
        self.steps.append(ir.NumberArray(ref, kind, code, size, pad, align, self.now))
        if kind.arity is Arity.ARRAY:
            if align > 1:
                self.now = ir.AlignmentState(None, size, 0)
            self._advance(pad + size * kind.capacity)
        else:
            self._lose_offset(known_modulus(kind))

    # --- sequences and arrays of messages -------------------------------------------------------------------------

    def _loop(self, ref: ir.Ref, kind: FieldType) -> None:
        """Append the step for the elements of a sequence or array of messages."""
        number = self._new_object()
        loop = self._packed_loop(ref, kind, number)
        if loop is None and self.planner.is_outlined(kind.base):
            loop = self._make_loop(ref, kind, number, ir.LoopMode.CALL)
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
            loop = self._make_loop(ref, kind, number, ir.LoopMode.INLINE, inner.steps)
            self.now = entry
        self.steps.append(loop)

    def _make_loop(
        self,
        ref: ir.Ref,
        kind: FieldType,
        number: int,
        mode: ir.LoopMode,
        body: Sequence[ir.LayoutStep] = (),
        stride: int = 0,
        padding: tuple[int, int] = (0, 1),
    ) -> ir.Loop:
        planner, base = self.planner, kind.base
        facts = planner.is_fixed(base), planner.has_structured_arrays(base)
        return ir.Loop(ref, kind, number, mode, tuple(body), stride, planner.min_size(base), *padding, self.now, *facts)

    def _element(self, ref: ir.Ref, kind: FieldType, number: int, entry: ir.AlignmentState) -> _PlanBuilder:
        inner = _PlanBuilder(self.planner, entry, self.next_object)
        inner.message(kind.base, number, f"{ref.path}[]")
        return inner

    def _packed_loop(self, ref: ir.Ref, kind: FieldType, number: int) -> ir.Loop | None:
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
            entries.append((ir.AlignmentState(None, first, 0), self._padding_before(first)))
        for entry, padding in entries:
            inner = self._element(ref, kind, number, entry)
            inner.end_run()
            runs = [step for step in inner.steps if isinstance(step, ir.PackedRun)]
            is_plain = all(isinstance(step, ir.PackedRun | ir.InlineMessage) for step in inner.steps)
            # One stride: a single run without unknown padding, which ends at the remainder where it started.
            if not is_plain or len(runs) != 1 or runs[0].align != 1 or inner.now.remainder != entry.remainder:
                continue
            self.next_object = inner.next_object
            loop = self._make_loop(ref, kind, number, ir.LoopMode.PACKED, inner.steps, runs[0].size, padding)
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
        return self._first_alignment(kind.base) if kind.is_message else element_alignment(kind)


def _common_alignment(left: ir.AlignmentState, right: ir.AlignmentState) -> ir.AlignmentState:
    """Return what two alignment states have in common, for a position that is described by either of them."""
    modulus = min(left.modulus, right.modulus)
    while modulus > 1 and left.remainder % modulus != right.remainder % modulus:
        modulus //= 2
    return ir.AlignmentState(None, modulus, left.remainder % modulus)
