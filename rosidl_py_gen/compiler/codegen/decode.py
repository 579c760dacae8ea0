"""Generator of the Python source that decodes a message.

In generated code, ``raw`` is the data from which scalars and strings are read, and ``view`` is the data whose memory
arrays share. ``pos`` is the offset of the next byte in the data, including the 4 bytes of the header. An offset that
does not depend on the message is emitted as a number.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.cdr.layout import Header, WStringUnit
from rosidl_py_gen.compiler.codegen import layout_plan
from rosidl_py_gen.compiler.codegen.python_text import Locals, singular
from rosidl_py_gen.compiler.codegen.statements import HEADER_CODE, Structs, block, check, plus, read_string

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.compiler.codegen.statements import MessageApi


class DecoderView(NamedTuple):
    """Generated decoder of a message, as values for the template of the generated module.

    Attributes:
        body: the statements of the decoder.
        uses_view: the statements make arrays that share the memory of the data, so the generated code needs the
            variable ``view`` in addition to ``raw``.
        checks_header: the first struct call also reads the encapsulation header of the CDR data.
        bulk: the message has numeric sequences, which may have megabytes, so a buffer that is not bytes is never
            copied. ``raw`` may then be a memoryview, from which strings are read a little slower.
        structured_arrays: sequences and arrays of fixed-size messages become structured arrays if ``arrays`` is true.
    """

    body: str
    uses_view: bool
    checks_header: bool
    bulk: bool
    structured_arrays: bool


def decoder_view(
    plan: layout_plan.LayoutPlan, api: MessageApi, structs: Structs, classes: dict[str, str]
) -> DecoderView:
    """Return the generated decoder of a message.

    If other messages call the decoder of this message instead of containing its code, the result is the body of
    `_read`.
    """
    first = next(step for step in plan.steps if not isinstance(step, layout_plan.InlineMessage))
    with_header = not plan.outlined and isinstance(first, layout_plan.PackedRun)
    bulk = not plan.outlined and any(isinstance(step, layout_plan.NumberArray) for step in plan.steps)
    emitter = _DecoderEmitter(api, structs, classes, with_header, bulk, plan.structured_arrays)
    emitter.objects[0] = "message"
    body = emitter.scope(plan.steps, keep_pos=plan.outlined)
    uses_view = emitter.uses_view or plan.outlined
    return DecoderView("\n".join(body), uses_view, with_header, bulk, plan.structured_arrays)


@dataclass(slots=True)
class _DecoderEmitter:
    """Emitter of the statements of one generated decoder.

    Attributes:
        header: the next struct call also reads the encapsulation header.
        is_after_string: the position is ``end + 1``, after the NUL of a string, and ``pos`` is not updated yet.
        objects: local variables of nested messages and elements, by object number.
        counts: local variables of lengths, by field.
    """

    api: MessageApi
    structs: Structs
    classes: dict[str, str]
    header: bool
    bulk: bool
    structured_arrays: bool
    is_after_string: bool = False
    uses_view: bool = False
    objects: dict[int, str] = field(default_factory=dict)
    counts: dict[layout_plan.Ref, str] = field(default_factory=dict)
    names: Locals = field(default_factory=Locals)

    def attribute(self, ref: layout_plan.Ref) -> str:
        return f"{self.objects[ref.owner]}.{self.api.attribute(ref.name)}"

    def at(self, start: layout_plan.AlignmentState) -> str:
        return "pos" if start.static is None else str(start.static + Header.SIZE)

    def scope(self, steps: Sequence[layout_plan.LayoutStep], keep_pos: bool) -> list[str]:
        """Return the statements that decode a list of layout steps.

        With `keep_pos`, the variable ``pos`` is up to date at their end.
        """
        out: list[str] = []
        reading = [not isinstance(step, layout_plan.InlineMessage | layout_plan.StringTerminator) for step in steps]
        last = max((index for index, is_reading in enumerate(reading) if is_reading), default=-1)
        for index, step in enumerate(steps):
            if reading[index] and not (isinstance(step, layout_plan.PackedRun) and step.align > 1):
                self.update_pos(out)
            self.step(step, keep_pos or index < last, out)
        if keep_pos:
            self.update_pos(out)
        return out

    def update_pos(self, out: list[str]) -> None:
        if self.is_after_string:
            self.is_after_string = False
            out.append("pos = end + 1")

    def step(self, step: layout_plan.LayoutStep, needed: bool, out: list[str]) -> None:
        """Append the statements that decode one step of the layout plan to `out`.

        `needed` is True if a later step reads ``pos``.
        """
        match step:
            case layout_plan.InlineMessage():
                self.create(step, out)
            case layout_plan.PackedRun():
                self.run(step, needed, out)
            case layout_plan.StringContent():
                self.string(step, needed, out)
            case layout_plan.StringTerminator():
                pass  # read with the characters
            case layout_plan.NumberArray():
                self.numbers(step, needed, out)
            case layout_plan.StringArray():
                function = self.api.support("unpack_wstrings" if step.type.base == "wstring" else "unpack_strings")
                count = self.count(step.ref, step.type, out)
                target = f"{self.attribute(step.ref)}, {'pos' if needed else '_'}"
                out.append(f"{target} = {function}(raw, {self.at(step.start)}, {count})")
            case layout_plan.Loop():
                self.loop(step, needed, out)
            case layout_plan.NestedCall():
                if step.start.static is not None:
                    out.append(f"pos = {self.at(step.start)}")
                self.call(self.attribute(step.ref), step, step.type, needed, out)
            case _:
                layout_plan.assert_never(step)

    def create(self, step: layout_plan.InlineMessage, out: list[str]) -> None:
        value = f"{self.api.support('new')}({self.classes[step.type]})"
        if not step.empty:
            name = self.objects[step.number] = self.names.name(step.ref.name)
            value = f"{name} = {value}"
        out.append(f"{self.attribute(step.ref)} = {value}")

    def call(
        self, target: str, step: layout_plan.NestedCall | layout_plan.Loop, cls: str, needed: bool, out: list[str]
    ) -> None:
        self.uses_view = True
        arrays = ", arrays" if step.structured_arrays else ""
        out.append(f"{target}, {'pos' if needed else '_'} = {self.classes[cls]}._read(raw, view, pos{arrays})")

    # --- position -------------------------------------------------------------------------------------------------

    def align(self, align: int, count: str, out: list[str]) -> None:
        """Emit the statement that aligns ``pos``.

        If `count` is not empty, the statement aligns only if the number of elements is not 0.
        """
        # `Header.align`; up to the size of the header the header does not matter.
        name, more = ("end", 1) if self.is_after_string else ("pos", 0)
        self.is_after_string = False
        if align > Header.SIZE:
            expression = f"({name} + {align - 1 - Header.SIZE + more} & -{align}) + {Header.SIZE}"
        else:
            expression = f"{name} + {align - 1 + more} & -{align}"
        self.move_if(count, expression, out)

    def move_if(self, count: str, expression: str, out: list[str]) -> None:
        move = f"pos = {expression}"
        out += block(f"if {count}", [move]) if count else [move]

    def move(self, at: str, distance: str, out: list[str]) -> None:
        if at == "pos":
            out.append(f"pos += {distance}")
        else:
            out.append(f"pos = {plus(at, int(distance)) if distance.isdigit() else f'{at} + {distance}'}")

    # --- steps ----------------------------------------------------------------------------------------------------

    def run(self, run: layout_plan.PackedRun, needed: bool, out: list[str]) -> None:
        if run.align > 1:
            self.align(run.align, "", out)
        at = self.at(run.start)
        targets: list[str] = []
        arrays: list[str] = []
        for item in run.items:
            match item:
                case layout_plan.Scalar(ref, _, _):
                    targets.append(self.attribute(ref))
                case layout_plan.LengthPrefix(ref, _):
                    name = self.counts[ref] = self.names.name(f"{ref.name}_count")
                    targets.append(name)
                case layout_plan.FixedNumberArray(ref, code, count, offset):
                    arrays.append(f"{self.attribute(ref)} = {self.view(code, str(count), plus(at, offset), True)}")
                case layout_plan.EmptyMessageByte():
                    pass
                case _:
                    layout_plan.assert_never(item)
        code, offset_argument = run.unpack, f", {at}"
        if self.header:
            code, offset_argument = HEADER_CODE + code, ""
            targets.insert(0, "head")
        unpack = f"{self.structs.name('unpack_from', code)}(raw{offset_argument})"
        joined = f"({targets[0]},)" if len(targets) == 1 else ", ".join(targets)
        # A run without targets is read as well: it raises if bytes are missing.
        out.append(f"{joined} = {unpack}" if targets else unpack)
        if self.header:
            self.header = False
            arguments = ", None, arrays" if self.structured_arrays else ""
            out.append(f"if head != {Header.VALUE}:  # the bytes 00 01")
            out.append(f"    return decode_slow(cls, data, copy{arguments})")
        out += arrays
        if needed and at == "pos":
            out.append(f"pos += {run.size}")

    def view(self, code: str, count: str, at: str, is_array: bool) -> str:
        self.uses_view = True
        return self.api.numbers(code, count, at, is_array=is_array)

    def count(self, ref: layout_plan.Ref, kind: FieldType, out: list[str]) -> str:
        """Return the expression for the number of elements, and emit the check of the maximum length of a bounded
        sequence.
        """
        if kind.arity is Arity.ARRAY:
            return str(kind.capacity)
        if kind.arity is Arity.BOUNDED:
            out += check(">", self.api.support("check_max_length"), self.counts[ref], kind.capacity)
        return self.counts[ref]

    def string(self, step: layout_plan.StringContent, needed: bool, out: list[str]) -> None:
        at, count, target = self.at(step.start), self.counts[step.ref], self.attribute(step.ref)
        if step.type.base == "wstring":
            out.append(f"{target} = {self.api.support('from_utf16')}(raw, {at}, {count})")
            if needed:
                self.move(at, f"{WStringUnit.SIZE} * {count}", out)
            return
        end = f"pos + {count} - 1" if at == "pos" else f"{int(at) - 1} + {count}"
        out += read_string(target, at, end, self.bulk)
        self.is_after_string = needed

    def numbers(self, step: layout_plan.NumberArray, needed: bool, out: list[str]) -> None:
        count = self.count(step.ref, step.type, out)
        at = self.padded(step, count, out)
        out.append(f"{self.attribute(step.ref)} = {self.view(step.code, count, at, step.type.arity is Arity.ARRAY)}")
        if needed and not _has_static_end(step):
            size = f"{step.item_size} * {count}" if step.item_size > 1 else count
            self.move(at, str(step.item_size * int(count)) if count.isdigit() else size, out)

    def padded(self, step: layout_plan.NumberArray | layout_plan.Loop, count: str, out: list[str]) -> str:
        """Emit the statements that skip the padding before elements, and return the position of the first element.

        Padding exists only if there is an element.
        """
        at = self.at(step.start)
        is_array = step.type.arity is Arity.ARRAY
        if step.align > 1:
            self.align(step.align, "" if is_array else count, out)
        elif step.pad and is_array:
            if at != "pos":
                return plus(at, step.pad)
            out.append(f"pos += {step.pad}")
        elif step.pad:
            if at != "pos":
                out.append(f"pos = {at}")
            self.move_if(count, f"pos + {step.pad}", out)
            return "pos"
        return at

    def loop(self, step: layout_plan.Loop, needed: bool, out: list[str]) -> None:
        count = self.count(step.ref, step.type, out)
        if not step.fixed:
            self.messages(step, count, needed, out)
            return
        self.uses_view = True
        cls, at = self.classes[step.type.base], self.at(step.start)
        target = f"{self.attribute(step.ref)}, {'pos' if needed else '_'}"
        out += block("if arrays", [f"{target} = {self.api.support('read_records')}({cls}, view, {at}, {count})"])
        messages: list[str] = []
        self.messages(step, count, needed, messages)
        out += block("else", messages)

    def messages(self, step: layout_plan.Loop, count: str, needed: bool, out: list[str]) -> None:
        values = self.names.name(step.ref.name)
        item = self.objects[step.number] = self.names.name(singular(step.ref.name))
        cls = self.classes[step.type.base]
        new_list = [f"{values}: list[{cls}] = []", f"{self.attribute(step.ref)} = {values}"]
        append = f"{values}.append({item})"
        body = [f"{item} = {self.api.support('new')}({cls})", append]
        if step.mode is layout_plan.LoopMode.PACKED:
            self.packed(step, count, new_list, body, needed, out)
            return
        if step.start.static is not None:
            out.append(f"pos = {self.at(step.start)}")
        self.check_remaining(f"pos + {step.min_size} * {count}" if step.min_size > 1 else f"pos + {count}", out)
        out += new_list
        if step.mode is layout_plan.LoopMode.CALL:
            body = []
            self.call(item, step, step.type.base, True, body)
            body.append(append)
        else:
            body += self.scope(step.body, keep_pos=True)
        out += block(f"for _ in range({count})", body)

    def check_remaining(self, end: str, out: list[str]) -> None:
        out.append(f"{self.api.support('check_remaining')}({end}, raw)")

    def packed(
        self, step: layout_plan.Loop, count: str, new_list: list[str], body: list[str], needed: bool, out: list[str]
    ) -> None:
        at = self.padded(step, count, out)
        run = next(inner for inner in step.body if isinstance(inner, layout_plan.PackedRun))
        arrays = [item for item in run.items if isinstance(item, layout_plan.FixedNumberArray)]
        if at != "pos" and arrays:
            out.append(f"pos = {at}")
            at = "pos"
        out.append(f"end = {at} + {step.stride} * {count}")
        self.check_remaining("end", out)
        out += new_list
        for inner in step.body:
            if isinstance(inner, layout_plan.InlineMessage):
                self.create(inner, body)
        targets: list[str] = []
        for item in run.items:
            if isinstance(item, layout_plan.Scalar):
                local = self.names.name(f"{self.objects[item.ref.owner]}_{item.ref.name}")
                targets.append(local)
                body.append(f"{self.attribute(item.ref)} = {local}")
        for array in arrays:
            view = self.view(array.code, str(array.length), plus("pos", array.offset), True)
            body.append(f"{self.attribute(array.ref)} = {view}")
        if arrays:
            body.append(f"pos += {step.stride}")
        unpack = self.structs.name("iter_unpack", run.unpack)
        variables = f"({targets[0]},)" if len(targets) == 1 else ", ".join(targets) or "_"
        out += block(f"for {variables} in {unpack}(memoryview(raw)[{at}:end])", body)
        if needed and not arrays and not _has_static_end(step):
            out.append("pos = end")


def _has_static_end(step: layout_plan.NumberArray | layout_plan.Loop) -> bool:
    """Return True if the position after a number array or loop is known at generation time, so ``pos`` need not be
    updated.
    """
    return step.type.arity is Arity.ARRAY and step.start.static is not None
