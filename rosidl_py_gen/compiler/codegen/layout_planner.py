"""Plan the wire layout of a message.

The rules of CDR are those of `cdr/layout.py`. This module applies them to fields and emits steps; views and templates
print steps and never count bytes. A struct has no alignment of its own: a nested message is laid out where it stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

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
    known_modulus,
    min_element_size,
)
from rosidl_py_gen.compiler.codegen.layout_ir import (
    AlignmentState,
    EmptyMessageByte,
    FixedNumberArray,
    InlineMessage,
    Item,
    LayoutPlan,
    LayoutStep,
    LengthPrefix,
    Loop,
    LoopMode,
    NestedCall,
    NumberArray,
    PackedRun,
    Ref,
    Scalar,
    StringArray,
    StringContent,
    StringTerminator,
)
from rosidl_py_gen.compiler.codegen.weights import Weights

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import MessageDef

# A fixed array of more bytes than this is joined as it is instead of being copied through a struct.
BLOCK_BYTES = 1024
_CODES = {base: primitive.code for base, primitive in PRIMITIVES.items()}
_RCLPY_CODES = {**_CODES, "byte": "c"}
"""Struct codes by primitive, and those of rclpy's flavour, in which a byte is bytes of length 1."""


class LayoutPlanner(Weights):
    """Plans by message name, each made once.

    Args:
        rclpy: for classes in which `byte` is bytes of length 1.
        max_leaves: as of `Weights`.
    """

    def __init__(
        self, lookup: Callable[[str], MessageDef | None], *, rclpy: bool = False, max_leaves: float = math.inf
    ) -> None:
        super().__init__(lookup, max_leaves)
        self.rclpy, self.codes = rclpy, _RCLPY_CODES if rclpy else _CODES
        self._plans: dict[str, LayoutPlan] = {}
        self._least: dict[str, int] = {}

    def plan(self, name: str) -> LayoutPlan:
        """The plan of a message whose references all exist."""
        if name not in self._plans:
            heavy = self.is_outlined(name)
            builder = _PlanBuilder(self, AlignmentState(None, 1, 0) if heavy else AlignmentState(0, MAX_ALIGN, 0))
            builder.message(name, 0, "")
            builder.close()
            self._plans[name] = LayoutPlan(name, tuple(builder.steps), heavy, self.has_records(name))
        return self._plans[name]

    def min_size(self, name: str) -> int:
        """The fewest bytes a message can take, padding left out."""
        if name not in self._least:
            total = 0
            for item in self.message(name).fields:
                kind = item.type
                if has_count(kind):
                    total += COUNT_BYTES
                else:
                    least = self.min_size(kind.base) if kind.is_message else min_element_size(kind)
                    total += least * fixed_count(kind)
            self._least[name] = max(len(EMPTY_MESSAGE), total)
        return self._least[name]


@dataclass(slots=True)
class _OpenRun:
    """Run of fixed-size values that still grows."""

    start: AlignmentState
    nul: bool
    items: list[Item] = field(default_factory=list)
    pack: list[tuple[str, int]] = field(default_factory=list)  # code and repeat; pads have code x
    unpack: list[tuple[str, int]] = field(default_factory=list)
    size: int = 0
    align: int = 1

    def put(self, code: str, count: int, read: str = "") -> None:
        for codes, letter in ((self.pack, code), (self.unpack, read or code)):
            if codes and codes[-1][0] == letter and letter != "s":
                codes[-1] = (letter, codes[-1][1] + count)
            else:
                codes.append((letter, count))


def _struct_code(codes: list[tuple[str, int]]) -> str:
    return "".join(letter if count == 1 else f"{count}{letter}" for letter, count in codes)


class _PlanBuilder:
    """Walks the fields of a message once and emits steps; `now` is what is known of the position."""

    def __init__(self, layouts: LayoutPlanner, start: AlignmentState, first_object: int = 1) -> None:
        self.layouts = layouts
        self.now = start
        self.steps: list[LayoutStep] = []
        self.run: _OpenRun | None = None
        self.nul = False  # a string's terminator is still to be written
        self.objects = first_object

    # --- position -------------------------------------------------------------------------------------------------

    def _advance(self, size: int) -> None:
        now = self.now
        static = None if now.static is None else now.static + size
        self.now = AlignmentState(static, now.modulus, (now.remainder + size) % now.modulus)

    def _known_padding(self, align: int) -> int | None:
        """Padding up to `align`, None when it is not known."""
        return -self.now.remainder % align if self.now.modulus % align == 0 else None

    def _lose_offset(self, modulus: int) -> None:
        """Content of varying size was written; it ends at a multiple of `modulus`."""
        self.now = AlignmentState(None, modulus, 0)

    # --- runs -----------------------------------------------------------------------------------------------------

    def _append_to_run(self, align: int, size: int, code: str, count: int, read: str = "") -> int:
        """Put a value into the current run, or a new one where its alignment is not known; returns its offset."""
        gap = self._known_padding(align)
        if gap is None and self.run is not None:
            self.end_run()
        if self.run is None:
            self.run = _OpenRun(self.now, self.nul)
            if self.nul:
                self.nul = False
                self._advance(len(NUL))
                gap = self._known_padding(align)
        run = self.run
        if gap is None:
            run.align = align
            self.now = AlignmentState(None, align, 0)
        elif gap:
            run.put("x", gap)
            run.size += gap
            self._advance(gap)
        offset = run.size
        run.put(code, count, read)
        run.size += size
        self._advance(size)
        return offset

    def end_run(self) -> None:
        run = self.run
        if run is not None:
            self.run = None
            codes = _struct_code(run.pack), _struct_code(run.unpack)
            self.steps.append(PackedRun(tuple(run.items), *codes, run.size, run.align, run.nul, run.start))

    def close(self) -> None:
        """Finish the current run and a pending terminator."""
        self.end_run()
        if self.nul:
            self.nul = False
            self.steps.append(StringTerminator(self.now))
            self._advance(len(NUL))

    # --- fields ---------------------------------------------------------------------------------------------------

    def message(self, name: str, owner: int, path: str) -> None:
        definition = self.layouts.message(name)
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
            size, code = kind.primitive.size, self.layouts.codes[kind.base]
            self._items(Scalar(ref, code, self._append_to_run(size, size, code, 1)))
        elif kind.is_string:
            self._count(ref)
            self.steps.append(StringContent(ref, kind, self.now))
            self._lose_offset(known_modulus(kind))
            self.nul = kind.base == "string"
        elif self.layouts.is_outlined(kind.base):
            self.close()
            self.steps.append(NestedCall(ref, kind.base, self.now, self.layouts.has_records(kind.base)))
            self._lose_offset(1)
        else:
            number = self._new_object()
            # No bytes: an open run goes on behind it. Views load or create objects before the run that uses them.
            empty = not self.layouts.message(kind.base).fields
            self.steps.append(InlineMessage(ref, kind.base, number, empty))
            self.message(kind.base, number, ref.path)

    def _new_object(self) -> int:
        self.objects += 1
        return self.objects - 1

    def _count(self, ref: Ref) -> None:
        self._items(LengthPrefix(ref, self._append_to_run(COUNT_BYTES, COUNT_BYTES, COUNT_CODE, 1)))
        self.end_run()

    def _many(self, ref: Ref, kind: FieldType) -> None:
        fixed = kind.arity is Arity.ARRAY
        primitive = kind.primitive
        if primitive is not None and fixed and primitive.size * kind.capacity <= BLOCK_BYTES:
            size = primitive.size * kind.capacity
            offset = self._append_to_run(primitive.size, size, "s", size, "x")
            self._items(FixedNumberArray(ref, self.layouts.codes[kind.base], kind.capacity, offset))
            return
        if fixed:
            self.close()
        else:
            self._count(ref)
        if primitive is not None:
            self._numbers(ref, kind, self.layouts.codes[kind.base], primitive.size)
        elif kind.is_string:
            pad, align = self._padding_before(element_alignment(kind))
            self.steps.append(StringArray(ref, kind, pad, align, self.now))
            self._lose_offset(known_modulus(kind))
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
            self._lose_offset(known_modulus(kind))

    # --- sequences and arrays of messages -------------------------------------------------------------------------

    def _loop(self, ref: Ref, kind: FieldType) -> None:
        number = self._new_object()
        least = self.layouts.min_size(kind.base)
        fixed, records = self.layouts.is_fixed(kind.base), self.layouts.has_records(kind.base)
        packed = self._packed(ref, kind, number, least)
        if packed is not None:
            self.steps.append(packed)
            return
        if self.layouts.is_outlined(kind.base):
            self.steps.append(Loop(ref, kind, number, LoopMode.CALL, (), 0, least, 0, 1, self.now, fixed, records))
            self._lose_offset(1)
            return
        begin = self.now
        entry = AlignmentState(None, begin.modulus, begin.remainder)
        while True:  # what is known at the loop's head must hold on every round
            inner = _PlanBuilder(self.layouts, entry, self.objects)
            inner.message(kind.base, number, f"{ref.path}[]")
            inner.close()
            met = _common_alignment(entry, inner.now)
            if met == entry:
                break
            entry = met
        self.objects = inner.objects
        body = tuple(inner.steps)
        self.steps.append(Loop(ref, kind, number, LoopMode.INLINE, body, 0, least, 0, 1, begin, fixed, records))
        self.now = entry._replace(static=None)

    def _packed(self, ref: Ref, kind: FieldType, number: int, least: int) -> Loop | None:
        """The loop over elements of one run at a fixed stride, None when the elements are not like that."""
        if not self.layouts.is_fixed(kind.base) or self.layouts.is_outlined(kind.base):
            return None
        entries = [(self.now._replace(static=None), (0, 1))]
        entries += [
            (AlignmentState(None, align, 0), self._padding_before(align))
            for align in (8, 4, 2)
            if self._first_needs(kind.base, align)
        ]
        for entry, (pad, align) in entries:
            inner = _PlanBuilder(self.layouts, entry, self.objects)
            inner.message(kind.base, number, f"{ref.path}[]")
            inner.end_run()
            runs = [step for step in inner.steps if isinstance(step, PackedRun)]
            plain = all(isinstance(step, (PackedRun, InlineMessage)) for step in inner.steps)
            if not plain or len(runs) != 1 or runs[0].align != 1 or inner.now.remainder != entry.remainder:
                continue
            self.objects = inner.objects
            body = tuple(inner.steps)
            size, records = runs[0].size, self.layouts.has_records(kind.base)
            loop = Loop(ref, kind, number, LoopMode.PACKED, body, size, least, pad, align, self.now, True, records)
            self._after_packed(kind, entry, loop)
            return loop
        return None

    def _after_packed(self, kind: FieldType, entry: AlignmentState, loop: Loop) -> None:
        if kind.arity is not Arity.ARRAY:
            self.now = _common_alignment(self.now, entry)._replace(static=None)
            return
        if loop.align > 1:
            self.now = entry
        self._advance(loop.pad + loop.stride * kind.capacity)

    def _first_needs(self, name: str, align: int) -> bool:
        """Whether the first byte of a message is aligned to `align`, so that elements begin there."""
        first = self.layouts.message(name).fields
        if not first:
            return align == 1
        kind = first[0].type
        if kind.primitive is not None:
            return kind.primitive.size == align
        return kind.is_message and self._first_needs(kind.base, align)


def _common_alignment(left: AlignmentState, right: AlignmentState) -> AlignmentState:
    """What holds whichever of the two is true."""
    modulus = min(left.modulus, right.modulus)
    while modulus > 1 and left.remainder % modulus != right.remainder % modulus:
        modulus //= 2
    return AlignmentState(None, modulus, left.remainder % modulus)
