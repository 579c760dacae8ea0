"""Generator of the Python source that encodes a message.

A message without loops is encoded by one join of packed values and variable contents. For a message with loops, the
generated code collects the encoded segments in a list. In generated code, ``pos`` is the position after the emitted
segments, counted from the origin of CDR alignment; ``pos`` is updated only where a later statement reads it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.layout import NUL, Alignment, Header
from rosidl_py_gen.compiler.codegen import layout_plan
from rosidl_py_gen.compiler.codegen.python_text import Locals, singular
from rosidl_py_gen.compiler.codegen.statements import HEADER_CODE, Structs, block, check, plus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.compiler.codegen.statements import MessageApi

Content = layout_plan.StringContent | layout_plan.NumberArray | layout_plan.StringArray | layout_plan.Loop


class EncoderView(NamedTuple):
    """Generated encoder of a message for the template of the module: its statements, and the expression of the encoded
    bytes.

    `result` is empty if the statements append the encoded segments to a list.
    """

    body: str
    result: str


def encoder_view(
    plan: layout_plan.LayoutPlan, api: MessageApi, structs: Structs, classes: dict[str, str]
) -> EncoderView:
    """Return the generated encoder of a message.

    If other messages call the encoder of this message instead of containing its code, the result is the body of
    `_write`.
    """
    collect = plan.outlined or any(isinstance(step, layout_plan.Loop | layout_plan.NestedCall) for step in plan.steps)
    emitter = _EncoderEmitter(api, structs, classes, collect, header=not plan.outlined)
    emitter.objects[0] = "self"
    first = next(step for step in plan.steps if not isinstance(step, layout_plan.InlineMessage))
    body: list[str] = []
    if emitter.header and not isinstance(first, layout_plan.PackedRun):
        emitter.header = False
        emitter.segment(_literal(Header.BYTES), body)
    body += emitter.scope(plan.steps, keep_pos=plan.outlined)
    segments = emitter.segments
    if collect:
        result = ""
    elif len(segments) == 1:
        result = segments[0]
    else:
        result = 'b"".join(({}\n))'.format("".join(f"\n    {segment}," for segment in segments))
    return EncoderView("\n".join(body), result)


def _literal(data: bytes) -> str:
    """Return the Python source of a bytes literal for a header, terminator or padding."""
    return 'b"' + "".join(f"\\{byte:o}" for byte in data) + '"'


def _reads_pos(step: layout_plan.LayoutStep) -> bool:
    match step:
        case layout_plan.PackedRun() | layout_plan.NumberArray() | layout_plan.StringArray():
            return step.align > 1
        case layout_plan.Loop():
            is_read_inside = step.mode is layout_plan.LoopMode.INLINE and any(map(_reads_pos, step.body))
            return step.align > 1 or step.mode is layout_plan.LoopMode.CALL or is_read_inside
        case layout_plan.NestedCall():
            return True
        case layout_plan.InlineMessage() | layout_plan.StringContent() | layout_plan.StringTerminator():
            return False
        case _:
            layout_plan.assert_never(step)


@dataclass(slots=True)
class _EncoderEmitter:
    """Emitter of the statements of one generated encoder.

    Attributes:
        collect: the generated code appends segments to a list; otherwise the emitter collects the segments'
            expressions, and the generated code joins them at the end.
        header: the next struct call also writes the encapsulation header.
        objects: local variables of nested messages and elements, by object number.
        values: local variables of converted contents, by field.
    """

    api: MessageApi
    structs: Structs
    classes: dict[str, str]
    collect: bool
    header: bool
    objects: dict[int, str] = field(default_factory=dict)
    contents: dict[layout_plan.Ref, Content] = field(default_factory=dict)
    values: dict[layout_plan.Ref, str] = field(default_factory=dict)
    segments: list[str] = field(default_factory=list)
    pos: str = "pos"
    moves: int = 0
    names: Locals = field(default_factory=Locals)

    def attribute(self, ref: layout_plan.Ref) -> str:
        return f"{self.objects[ref.owner]}.{self.api.attribute(ref.name)}"

    def scope(self, steps: Sequence[layout_plan.LayoutStep], keep_pos: bool) -> list[str]:
        """Return the statements that encode a list of layout steps.

        With `keep_pos`, the variable ``pos`` is up to date at their end.
        """
        out: list[str] = []
        self.contents |= {step.ref: step for step in steps if isinstance(step, Content)}
        last = max((index for index, step in enumerate(steps) if _reads_pos(step)), default=-1)
        for index, step in enumerate(steps):
            self.step(step, keep_pos or index < last, out)
        return out

    def step(self, step: layout_plan.LayoutStep, needed: bool, out: list[str]) -> None:
        """Append the statements that encode one step of the layout plan to `out`.

        `needed` is True if a later step reads ``pos``.
        """
        match step:
            case layout_plan.InlineMessage():
                name = self.names.name(step.ref.name)
                out += self.load(name, step.type, self.attribute(step.ref))
                self.objects[step.number] = name
            case layout_plan.PackedRun():
                self.run(step, needed, out)
            case layout_plan.StringContent():
                value = self.values[step.ref]
                self.segment(value, out)
                self.move(step.start, f"len({value})", needed, out)
            case layout_plan.StringTerminator():
                self.segment(_literal(NUL), out)
                self.move(step.start, str(len(NUL)), needed, out)
            case layout_plan.NumberArray():
                value = self.fetch(step, out)
                size = f"{step.item_size} * len({value})" if step.item_size > 1 else f"len({value})"
                self.padded(step, value, value, size, needed, out)
            case layout_plan.StringArray():
                self.strings(step, needed, out)
            case layout_plan.Loop():
                self.loop(step, needed, out)
            case layout_plan.NestedCall():
                name = self.names.name(step.ref.name)
                out += self.load(name, step.type, self.attribute(step.ref))
                self.set_static_pos(step.start, out)
                out.append(self.call(step.type, name))
            case _:
                layout_plan.assert_never(step)

    def load(self, name: str, cls: str, expression: str = "") -> list[str]:
        """Return the statements that assign an expression, if it is not empty, to a variable and check the class of the
        nested message.
        """
        coerce, cls = self.api.support("coerce_message"), self.classes[cls]
        fetch = [f"{name} = {expression}"] if expression else []
        return [*fetch, *block(f"if type({name}) is not {cls}", [f"{name} = {coerce}({name}, {cls})"])]

    def call(self, cls: str, name: str) -> str:
        return f"pos = {self.classes[cls]}._write({name}, append, pos)"

    def segment(self, expression: str, out: list[str]) -> None:
        if self.collect:
            out.append(f"append({expression})")
        else:
            self.segments.append(expression)

    # --- position -------------------------------------------------------------------------------------------------

    def move(self, start: layout_plan.AlignmentState, distance: str, needed: bool, out: list[str]) -> None:
        """Emit the statement that advances ``pos`` by a distance, if `needed` is True.

        If ``pos`` is not up to date, it is set to the sum of the known position `start` and the distance.
        """
        if not needed or (start.static is not None and distance.isdigit()):  # the next step has a static position
            return
        if start.static is not None:
            self.set_pos(f"{start.static} + {distance}" if start.static else distance, out)
        elif self.collect:
            out.append(f"pos += {distance}")
        else:
            self.set_pos(f"{self.pos} + {distance}", out)

    def set_pos(self, expression: str, out: list[str]) -> None:
        """Emit the statement that sets the variable ``pos`` to a position in the encoded message.

        If the generated encoder joins all segments at its end, it needs every position there, so each position gets a
        separate variable.
        """
        if not self.collect:
            self.moves += 1
            self.pos = "pos" if self.moves == 1 else self.names.name(f"pos{self.moves}")
        out.append(f"{self.pos} = {expression}")

    def set_static_pos(self, start: layout_plan.AlignmentState, out: list[str]) -> None:
        if start.static is not None:
            self.set_pos(str(start.static), out)

    # --- steps ----------------------------------------------------------------------------------------------------

    def run(self, run: layout_plan.PackedRun, needed: bool, out: list[str]) -> None:
        arguments: list[str] = []
        code = run.pack
        if self.header:
            self.header = False
            code = HEADER_CODE + code
            arguments.append(str(Header.VALUE))
        for item in run.items:
            match item:
                case layout_plan.Scalar(ref, "?", _):
                    arguments.append(f"{self.api.support('BOOL')}[{self.attribute(ref)}]")
                case layout_plan.Scalar(ref, _, _):
                    arguments.append(self.attribute(ref))
                case layout_plan.FixedNumberArray(ref, kind, count, _):
                    arguments.append(f"{self.api.fixed(kind)}({self.attribute(ref)}, {count})")
                case layout_plan.LengthPrefix(ref, _):
                    arguments.append(self.prepare(self.contents[ref], out))
                case layout_plan.EmptyMessageByte():
                    pass
                case _:
                    layout_plan.assert_never(item)
        if run.nul and run.align == 1:
            code = "x" + code
        pack = self.structs.name("pack", code, run.align, run.nul and run.align > 1)
        index = f"[{self.pos} & {Alignment.MAX - 1}]" if run.align > 1 else ""
        self.segment(f"{pack}{index}({', '.join(arguments)})", out)
        if needed and run.align > 1:
            skip = run.align - 1 + run.nul
            self.set_pos(f"({self.pos} + {skip} & -{run.align}) + {run.size}", out)
        else:
            self.move(run.start, str(run.size + run.nul), needed, out)

    def prepare(self, step: Content, out: list[str]) -> str:
        """Emit the statements that fetch and convert a string or sequence, and return the expression of its length
        field.

        The length is packed together with the values before the content, so the content is converted before them.
        """
        source, kind = self.attribute(step.ref), step.type
        name = self.values[step.ref] = self.names.name(step.ref.name)
        if isinstance(step, layout_plan.StringContent):
            if kind.string_bound:
                out += check(">", self.api.support("check_max_length"), f"len({source})", kind.string_bound)
            is_wstring = kind.base == "wstring"
            out.append(f"{name} = {self.api.support('utf16' if is_wstring else 'utf8')}({source})")
            return f"len({name}) >> 2" if is_wstring else f"len({name}) + 1"
        if isinstance(step, layout_plan.NumberArray):
            function = self.api.sequence(step.code, is_array=kind.arity is Arity.ARRAY)
            out.append(f"{name} = {function}({source})")
        else:
            out.append(f"{name} = {self.api.listed(source)}")
            if isinstance(step, layout_plan.Loop):
                function = self.api.support("list_or_records" if step.fixed else "coerce_message_list")
                target = f"{name} = " if step.fixed else ""
                out += block(f"if type({name}) is not list", [f"{target}{function}({name})"])
        if kind.arity is Arity.BOUNDED:
            out += check(">", self.api.support("check_max_length"), f"len({name})", kind.capacity)
        return f"len({name})"

    def fetch(self, step: layout_plan.NumberArray | layout_plan.StringArray | layout_plan.Loop, out: list[str]) -> str:
        """Return the name of the variable with a converted content.

        Emit the conversion of a fixed array, which has no length field.
        """
        if step.ref not in self.values:
            count = self.prepare(step, out)
            out += check("!=", self.api.support("check_length"), count, step.type.capacity)
        return self.values[step.ref]

    def strings(self, step: layout_plan.StringArray, needed: bool, out: list[str]) -> None:
        value = self.fetch(step, out)
        if step.type.string_bound:
            out.append(f"{self.api.support('check_max_lengths')}({value}, {step.type.string_bound})")
        packed = self.names.name(f"{step.ref.name}_packed")
        function = self.api.support("pack_wstrings" if step.type.base == "wstring" else "pack_strings")
        out.append(f"{packed} = {function}({value})")
        self.padded(step, value, packed, f"len({packed})", needed, out)

    def padded(
        self,
        step: layout_plan.NumberArray | layout_plan.StringArray | layout_plan.Loop,
        value: str,
        content: str,
        size: str,
        needed: bool,
        out: list[str],
    ) -> None:
        """Emit the padding before elements, which exists only if there is an element, then the elements unless
        `content` is empty.
        """
        is_array = step.type.arity is Arity.ARRAY
        start = step.start
        condition = "" if is_array else f' if len({value}) else b""'
        if step.align > 1:
            self.segment(f"{self.api.support(f'PAD{step.align}')}[{self.pos} & {step.align - 1}]{condition}", out)
        elif step.pad:
            self.segment(f"{_literal(bytes(step.pad))}{condition}", out)
        if content:
            self.segment(content, out)
        if not needed or (is_array and start.static is not None and not isinstance(step, layout_plan.StringArray)):
            return  # the step after an array of fixed size has a static position
        if step.align == 1 and (is_array or not step.pad):
            self.move(start, f"{step.pad} + {size}" if step.pad else size, needed, out)
            return
        old = self.pos
        if step.align > 1:
            expression = f"({old} + {step.align - 1} & -{step.align}) + {size}"
        else:
            old = old if start.static is None else str(start.static)
            expression = plus(old, step.pad) + f" + {size}"
        if is_array:
            self.set_pos(expression, out)
        else:
            if old != "pos" or not self.collect:
                self.set_pos(old, out)
            out += block(f"if len({value})", [f"{self.pos} = {expression}"])

    def loop(self, step: layout_plan.Loop, needed: bool, out: list[str]) -> None:
        value = self.fetch(step, out)
        if not step.fixed:
            self.messages(step, value, needed, out)
            return
        arguments = f"{self.classes[step.type.base]}, {value}, append, {self.known_pos(step, needed)}"
        write = f"{self.api.support('write_records')}({arguments})"
        messages: list[str] = []
        self.messages(step, value, needed, messages)
        out += block(f"if {self.api.is_array(value)}", [f"pos = {write}" if needed else write])
        out += block("else", messages)

    def known_pos(self, step: layout_plan.Loop, needed: bool) -> str:
        """Return the position of the first element, or a number with the same alignment if the variable ``pos`` is not
        up to date.
        """
        if step.start.static is not None:
            return str(step.start.static)
        return self.pos if needed or _reads_pos(step) else str(step.start.remainder)

    def messages(self, step: layout_plan.Loop, value: str, needed: bool, out: list[str]) -> None:
        item = self.objects[step.number] = self.names.name(singular(step.ref.name))
        body = self.load(item, step.type.base)
        if step.mode is layout_plan.LoopMode.PACKED:
            self.padded(step, value, "", f"{step.stride} * len({value})", needed, out)
            body += self.scope(step.body, keep_pos=False)
        elif step.mode is layout_plan.LoopMode.INLINE:
            keep_pos = needed or any(map(_reads_pos, step.body))
            if keep_pos:
                self.set_static_pos(step.start, out)
            body += self.scope(step.body, keep_pos)
        else:
            self.set_static_pos(step.start, out)
            body.append(self.call(step.type.base, item))
        out += block(f"for {item} in {value}", body)
