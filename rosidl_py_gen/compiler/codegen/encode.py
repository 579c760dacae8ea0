"""The encoder of a message as statements.

A message without loops is one join of packed runs and contents. With loops the parts are collected in a list. `pos` is
the position behind what was written so far, counted from the alignment origin; kept only where something reads it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.layout import HEADER, HEADER_CODE, HEADER_VALUE, MAX_ALIGN, NUL
from rosidl_py_gen.compiler.codegen.layout_ir import (
    AlignmentState,
    EmptyMessageByte,
    FixedNumberArray,
    InlineMessage,
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
    assert_never,
)
from rosidl_py_gen.compiler.codegen.naming import Locals, singular
from rosidl_py_gen.compiler.codegen.statements import (
    Align,
    Assign,
    CheckLength,
    CheckMaxLength,
    CheckMaxLengths,
    EmitBytes,
    For,
    IfElse,
    Load,
    LoadList,
    LoadRecords,
    Move,
    Statement,
    Structs,
    Unpack,
    Write,
    plus,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.compiler.codegen.message_api import Flavour


class EncoderView(NamedTuple):
    """The encoder as the template prints it.

    Attributes:
        statements: the body.
        result: the bytes expression when parts are joined at the end of it, empty when they are collected in a list.
    """

    statements: tuple[Statement, ...]
    result: str


def encoder_view(plan: LayoutPlan, flavour: Flavour, structs: Structs, classes: dict[str, str]) -> EncoderView:
    """The encoder of one message; for a heavy one the body of `_write`."""
    collect = plan.outlined or any(isinstance(step, (Loop, NestedCall)) for step in plan.steps)
    writer = _EncoderEmitter(flavour, structs, classes, collect, header=not plan.outlined)
    writer.objects[0] = "self"
    first = next(step for step in plan.steps if not isinstance(step, InlineMessage))
    body: list[Statement] = []
    if writer.header and not isinstance(first, PackedRun):
        writer.header = False
        writer.part(_literal(HEADER), body)
    body += writer.scope(plan.steps, keep_pos=plan.outlined)
    if collect:
        return EncoderView(tuple(body), "")
    parts = writer.parts
    joined = "".join(f"\n    {part}," for part in parts)
    return EncoderView(tuple(body), parts[0] if len(parts) == 1 else f'b"".join(({joined}\n))')


def _literal(data: bytes) -> str:
    """Return the expression of a few bytes of layout: header, terminator or padding."""
    return 'b"' + "".join(f"\\{byte:o}" for byte in data) + '"'


def _reads_pos(step: LayoutStep) -> bool:
    """Whether writing this step looks at `pos`."""
    match step:
        case PackedRun() | NumberArray() | StringArray():
            return step.align > 1
        case Loop():
            inside = any(_reads_pos(inner) for inner in step.body)
            return step.align > 1 or step.mode is LoopMode.CALL or (step.mode is LoopMode.INLINE and inside)
        case NestedCall():
            return True
        case InlineMessage() | StringContent() | StringTerminator():
            return False
        case _:
            assert_never(step)


Contents = dict[Ref, StringContent | NumberArray | StringArray | Loop]


@dataclass(slots=True)
class _EncoderEmitter:
    flavour: Flavour
    structs: Structs
    classes: dict[str, str]
    collect: bool
    header: bool
    objects: dict[int, str] = field(default_factory=dict)
    values: dict[Ref, str] = field(default_factory=dict)
    parts: list[str] = field(default_factory=list)
    pos: str = "pos"
    moves: int = 0
    names: Locals = field(default_factory=Locals)

    def support(self, name: str) -> str:
        return self.flavour.support(name)

    def attribute(self, ref: Ref) -> str:
        return f"{self.objects[ref.owner]}.{self.flavour.attribute(ref.name)}"

    def scope(self, steps: Sequence[LayoutStep], keep_pos: bool) -> list[Statement]:
        """The statements of some steps; `keep_pos`: `pos` must be right behind the last one."""
        out: list[Statement] = []
        contents: Contents = {
            step.ref: step for step in steps if isinstance(step, (StringContent, NumberArray, StringArray, Loop))
        }
        last = max((index for index, step in enumerate(steps) if _reads_pos(step)), default=-1)
        for index, step in enumerate(steps):
            needed = keep_pos or index < last
            self.step(step, needed, contents, out)
        return out

    def step(self, step: LayoutStep, needed: bool, contents: Contents, out: list[Statement]) -> None:
        match step:
            case InlineMessage():
                name = self.names.name(step.ref.name)
                out.append(self.load(name, self.attribute(step.ref), step.type))
                self.objects[step.number] = name
            case PackedRun():
                self.run(step, needed, contents, out)
            case StringContent():
                value = self.values[step.ref]
                self.part(value, out)
                self.move(step.start, f"len({value})", needed, out)
            case StringTerminator():
                self.part(_literal(NUL), out)
                self.move(step.start, str(len(NUL)), needed, out)
            case NumberArray():
                self.numbers(step, needed, contents, out)
            case StringArray():
                self.strings(step, needed, contents, out)
            case Loop():
                self.loop(step, needed, contents, out)
            case NestedCall():
                name = self.names.name(step.ref.name)
                out.append(self.load(name, self.attribute(step.ref), step.type))
                self.materialise(step.start, out)
                out.append(Write(self.classes[step.type], name))
            case _:
                assert_never(step)

    def load(self, name: str, expression: str, cls: str) -> Load:
        self.support("coerce_message")
        return Load(name, expression, self.classes[cls])

    def part(self, expression: str, out: list[Statement]) -> None:
        if self.collect:
            out.append(EmitBytes(expression))
        else:
            self.parts.append(expression)

    # --- position -------------------------------------------------------------------------------------------------

    def move(self, start: AlignmentState, distance: str, needed: bool, out: list[Statement]) -> None:
        """`pos` grows by a distance; where it was not kept so far, `start` says it."""
        if not needed or (start.static is not None and distance.isdigit()):  # what follows knows its own place
            return
        if start.static is not None:
            self.position(f"{start.static} + {distance}" if start.static else distance, out)
        elif self.collect:
            out.append(Move("+=", distance))
        else:
            self.position(f"{self.pos} + {distance}", out)

    def position(self, expression: str, out: list[Statement]) -> None:
        """`pos` becomes an expression; where parts are joined at the end every position keeps a name of its own."""
        if not self.collect:
            self.moves += 1
            self.pos = "pos" if self.moves == 1 else self.names.name(f"pos{self.moves}")
        out.append(Move("=", expression, self.pos))

    def position_if(self, value: str, expression: str, otherwise: str, out: list[Statement]) -> None:
        """`pos` becomes an expression, but only when there are elements; `value` empty: always."""
        if not value:
            self.position(expression, out)
            return
        if otherwise != "pos" or not self.collect:
            self.position(otherwise, out)
        out.append(Align(self.pos, expression, f"len({value})"))

    def materialise(self, start: AlignmentState, out: list[Statement]) -> None:
        if start.static is not None:
            self.position(str(start.static), out)

    # --- steps ----------------------------------------------------------------------------------------------------

    def run(self, run: PackedRun, needed: bool, contents: Contents, out: list[Statement]) -> None:
        arguments: list[str] = []
        code = run.pack
        if self.header:
            self.header = False
            code = HEADER_CODE + code
            arguments.append(str(HEADER_VALUE))
        for item in run.items:
            match item:
                case Scalar(ref, "?", _):
                    arguments.append(f"{self.support('BOOL')}[{self.attribute(ref)}]")
                case Scalar(ref, _, _):
                    arguments.append(self.attribute(ref))
                case FixedNumberArray(ref, kind, count, _):
                    arguments.append(f"{self.flavour.fixed(kind)}({self.attribute(ref)}, {count})")
                case LengthPrefix(ref, _):
                    arguments.append(self.prepare(contents[ref], out))
                case EmptyMessageByte():
                    pass
                case _:
                    assert_never(item)
        if run.nul and run.align == 1:
            code = "x" + code
        pack = self.structs.name("pack", code, run.align, run.nul and run.align > 1)
        index = f"[{self.pos} & {MAX_ALIGN - 1}]" if run.align > 1 else ""
        self.part(f"{pack}{index}({', '.join(arguments)})", out)
        if not needed:
            return
        if run.align > 1:
            skip = run.align - 1 + run.nul
            self.position(f"({self.pos} + {skip} & -{run.align}) + {run.size}", out)
        else:
            self.move(run.start, str(run.size + run.nul), needed, out)

    def prepare(self, step: StringContent | NumberArray | StringArray | Loop, out: list[Statement]) -> str:
        """Fetch and convert a content before the run that carries its count; returns the count expression."""
        source, kind = self.attribute(step.ref), step.type
        name = self.values[step.ref] = self.names.name(step.ref.name)
        if isinstance(step, StringContent):
            if kind.string_bound:
                self.support("check_max_length")
                out.append(CheckMaxLength(f"len({source})", kind.string_bound))
            wide = kind.base == "wstring"
            out.append(Assign(name, f"{self.support('utf16' if wide else 'utf8')}({source})"))
            return f"len({name}) >> 2" if wide else f"len({name}) + 1"
        if isinstance(step, NumberArray):
            function = self.flavour.sequence(step.code, is_array=kind.arity is Arity.ARRAY)
            out.append(Assign(name, f"{function}({source})"))
        elif isinstance(step, Loop) and step.fixed:
            self.support("list_or_records")
            out.append(LoadRecords(name, self.flavour.listed(source)))
        elif isinstance(step, Loop):
            self.support("coerce_message_list")
            out.append(LoadList(name, self.flavour.listed(source)))
        else:
            out.append(Assign(name, self.flavour.listed(source)))
        if kind.arity is Arity.BOUNDED:
            self.support("check_max_length")
            out.append(CheckMaxLength(f"len({name})", kind.capacity))
        return f"len({name})"

    def fetch(self, step: NumberArray | StringArray | Loop, contents: Contents, out: list[Statement]) -> str:
        """The variable that holds a content; a fixed array has no count, so it is fetched here."""
        if step.ref not in self.values:
            count = self.prepare(contents[step.ref], out)
            self.support("check_length")
            out.append(CheckLength(count, step.type.capacity))
        return self.values[step.ref]

    def numbers(self, step: NumberArray, needed: bool, contents: Contents, out: list[Statement]) -> None:
        value = self.fetch(step, contents, out)
        scaled = f"{step.item_size} * len({value})" if step.item_size > 1 else f"len({value})"
        self.padded(step, value, value, scaled, needed, out)

    def strings(self, step: StringArray, needed: bool, contents: Contents, out: list[Statement]) -> None:
        value = self.fetch(step, contents, out)
        if step.type.string_bound:
            self.support("check_max_lengths")
            out.append(CheckMaxLengths(value, step.type.string_bound))
        packed = self.names.name(f"{step.ref.name}_packed")
        function = self.support("pack_wstrings" if step.type.base == "wstring" else "pack_strings")
        out.append(Assign(packed, f"{function}({value})"))
        self.padded(step, value, packed, f"len({packed})", needed, out)

    def padded(
        self,
        step: NumberArray | StringArray | Loop,
        value: str,
        content: str,
        size: str,
        needed: bool,
        out: list[Statement],
    ) -> None:
        """Padding that is only there when elements are, and then the elements (unless `content` is empty)."""
        certain = step.type.arity is Arity.ARRAY
        start = step.start
        if step.align > 1:
            pad = f"{self.support(f'PAD{step.align}')}[{self.pos} & {step.align - 1}]"
            self.part(pad if certain else f'{pad} if len({value}) else b""', out)
        elif step.pad:
            zeros = _literal(bytes(step.pad))
            self.part(zeros if certain else f'{zeros} if len({value}) else b""', out)
        if content:
            self.part(content, out)
        if not needed or (certain and start.static is not None and not isinstance(step, StringArray)):
            return  # what follows an array of fixed size knows its own place
        if step.align > 1:
            moved = f"({self.pos} + {step.align - 1} & -{step.align}) + {size}"
            self.position_if(value if not certain else "", moved, self.pos, out)
        elif step.pad and not certain:
            at = str(start.static) if start.static is not None else self.pos
            self.position_if(value, plus(at, step.pad) + f" + {size}", at, out)
        else:
            self.move(start, f"{step.pad} + {size}" if step.pad else size, needed, out)

    def loop(self, step: Loop, needed: bool, contents: Contents, out: list[Statement]) -> None:
        value = self.fetch(step, contents, out)
        if not step.fixed:
            self.messages(step, value, needed, out)
            return
        self.support("ndarray")
        arguments = f"{self.classes[step.type.base]}, {value}, append, {self.known(step, needed)}"
        call = f"{self.support('write_records')}({arguments})"
        write = Assign("pos", call) if needed else Unpack("", call)
        otherwise: list[Statement] = []
        self.messages(step, value, needed, otherwise)
        out.append(IfElse(f"type({value}) is ndarray", (write,), tuple(otherwise)))

    def known(self, step: Loop, needed: bool) -> str:
        """The position of the elements, or a number that is aligned as it is where nothing keeps the position."""
        if step.start.static is not None:
            return str(step.start.static)
        return self.pos if needed or _reads_pos(step) else str(step.start.remainder)

    def messages(self, step: Loop, value: str, needed: bool, out: list[Statement]) -> None:
        """The elements of a list of messages."""
        item = self.names.name(singular(step.ref.name))
        self.objects[step.number] = item
        body: list[Statement] = [self.load(item, "", step.type.base)]
        if step.mode is LoopMode.PACKED:
            self.padded(step, value, "", f"{step.stride} * len({value})", needed, out)
            body += self.scope(step.body, keep_pos=False)
        elif step.mode is LoopMode.INLINE:
            inside = any(_reads_pos(inner) for inner in step.body)
            if needed or inside:
                self.materialise(step.start, out)
            body += self.scope(step.body, keep_pos=needed or inside)
        else:
            self.materialise(step.start, out)
            body.append(Write(self.classes[step.type.base], item))
        out.append(For(item, value, tuple(body)))
