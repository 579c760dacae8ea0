"""The decoder of a message as statements.

`raw` is what scalars and strings are read from, `view` what array views are taken of; `pos` is the offset of the next
byte in the data, 4 more than the position the plan speaks of. While it is known statically, it is printed as a number.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.cdr.layout import HEADER_BYTES, HEADER_CODE, HEADER_VALUE, WSTRING_UNIT_BYTES
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
    AppendElement,
    Assign,
    CheckHeader,
    CheckMaxLength,
    CheckRemaining,
    Create,
    For,
    IfElse,
    Move,
    NewList,
    ReadHeavy,
    ReadText,
    Statement,
    Structs,
    Unpack,
    plus,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.compiler.codegen.message_api import Flavour


class DecoderView(NamedTuple):
    """The decoder as the template prints it.

    Attributes:
        statements: the body.
        uses_view: it takes array views, so it needs `view` besides `raw`.
        checks_header: the first run reads the encapsulation header too.
        bulk: it has numeric sequences, which may be megabytes, so a buffer that is not bytes is never copied: `raw` may
            then be a memoryview, and strings are read in a way that is a little slower.
        records: it leaves sequences and arrays of fixed-size messages as they are when `arrays` says so.
    """

    statements: tuple[Statement, ...]
    uses_view: bool
    checks_header: bool
    bulk: bool
    records: bool


def decoder_view(plan: LayoutPlan, flavour: Flavour, structs: Structs, classes: dict[str, str]) -> DecoderView:
    """The decoder of one message; for a heavy one the body of `_read`."""
    first = next(step for step in plan.steps if not isinstance(step, InlineMessage))
    with_header = not plan.outlined and isinstance(first, PackedRun)
    bulk = not plan.outlined and any(isinstance(step, NumberArray) for step in plan.steps)
    reader = _DecoderEmitter(flavour, structs, classes, header=with_header, bulk=bulk, records=plan.structured_arrays)
    reader.objects[0] = "message"
    body = reader.scope(plan.steps, keep_pos=plan.outlined)
    return DecoderView(tuple(body), reader.uses_view or plan.outlined, with_header, bulk, plan.structured_arrays)


@dataclass(slots=True)
class _DecoderEmitter:
    flavour: Flavour
    structs: Structs
    classes: dict[str, str]
    header: bool = False  # the next run begins with the encapsulation header
    bulk: bool = False
    records: bool = False
    late: bool = False  # the position is `end + 1`, behind a string's NUL, and `pos` does not say so yet
    uses_view: bool = False
    objects: dict[int, str] = field(default_factory=dict)
    counts: dict[Ref, str] = field(default_factory=dict)
    names: Locals = field(default_factory=Locals)

    def support(self, name: str) -> str:
        return self.flavour.support(name)

    def attribute(self, ref: Ref) -> str:
        return f"{self.objects[ref.owner]}.{self.flavour.attribute(ref.name)}"

    def at(self, start: AlignmentState) -> str:
        """Where a step begins, as an expression."""
        return "pos" if start.static is None else str(start.static + HEADER_BYTES)

    def scope(self, steps: Sequence[LayoutStep], keep_pos: bool) -> list[Statement]:
        """The statements of some steps; `keep_pos`: `pos` must be right behind the last one."""
        out: list[Statement] = []
        last = max(
            (index for index, step in enumerate(steps) if not isinstance(step, (InlineMessage, StringTerminator))),
            default=-1,
        )
        for index, step in enumerate(steps):
            needed = keep_pos or index < last
            if not (
                isinstance(step, InlineMessage | StringTerminator) or (isinstance(step, PackedRun) and step.align > 1)
            ):
                self.catch_up(out)
            self.step(step, needed, out)
        if keep_pos:
            self.catch_up(out)
        return out

    def catch_up(self, out: list[Statement]) -> None:
        if self.late:
            self.late = False
            out.append(Move("=", "end + 1"))

    def step(self, step: LayoutStep, needed: bool, out: list[Statement]) -> None:
        match step:
            case InlineMessage():
                self.create(step, out)
            case PackedRun():
                self.run(step, needed, out)
            case StringContent():
                self.text(step, needed, out)
            case StringTerminator():
                pass  # a reader takes it with the characters
            case NumberArray():
                self.numbers(step, needed, out)
            case StringArray():
                function = self.support("unpack_wstrings" if step.type.base == "wstring" else "unpack_strings")
                count = self.count(step.ref, step.type, out)
                pos = "pos" if needed else "_"
                call = f"{function}(raw, {self.at(step.start)}, {count})"
                out.append(Assign(f"{self.attribute(step.ref)}, {pos}", call))
            case Loop():
                self.loop(step, needed, out)
            case NestedCall():
                if step.start.static is not None:
                    out.append(Move("=", self.at(step.start)))
                self.outlined(self.attribute(step.ref), step, step.type, needed, out)
            case _:
                assert_never(step)

    def create(self, step: InlineMessage, out: list[Statement]) -> None:
        self.support("new")
        cls = self.classes[step.type]
        if step.empty:
            out.append(Assign(self.attribute(step.ref), f"new({cls})"))
            return
        name = self.objects[step.number] = self.names.name(step.ref.name)
        out.append(Create(self.attribute(step.ref), name, cls))

    def outlined(self, target: str, step: NestedCall | Loop, cls: str, needed: bool, out: list[Statement]) -> None:
        self.uses_view = True
        out.append(ReadHeavy(target, "pos" if needed else "_", self.classes[cls], step.structured_arrays))

    # --- position -------------------------------------------------------------------------------------------------

    def align(self, align: int, when: str, out: list[Statement]) -> None:
        # `align_offset`; up to the size of the header the header does not matter.
        name, more = ("end", 1) if self.late else ("pos", 0)
        self.late = False
        if align > HEADER_BYTES:
            expression = f"({name} + {align - 1 - HEADER_BYTES + more} & -{align}) + {HEADER_BYTES}"
        else:
            expression = f"{name} + {align - 1 + more} & -{align}"
        out.append(Align("pos", expression, when))

    def move(self, at: str, distance: str, out: list[Statement]) -> None:
        if at == "pos":
            out.append(Move("+=", distance))
        else:
            out.append(Move("=", plus(at, int(distance)) if distance.isdigit() else f"{at} + {distance}"))

    # --- steps ----------------------------------------------------------------------------------------------------

    def run(self, run: PackedRun, needed: bool, out: list[Statement]) -> None:
        if run.align > 1:
            self.align(run.align, "", out)
        at = self.at(run.start)
        targets: list[str] = []
        blocks: list[Statement] = []
        for item in run.items:
            match item:
                case Scalar(ref, _, _):
                    targets.append(self.attribute(ref))
                case LengthPrefix(ref, _):
                    name = self.counts[ref] = self.names.name(f"{ref.name}_count")
                    targets.append(name)
                case FixedNumberArray(ref, code, count, offset):
                    blocks.append(Assign(self.attribute(ref), self.view(code, str(count), plus(at, offset), True)))
                case EmptyMessageByte():
                    pass
                case _:
                    assert_never(item)
        code, offset_argument = run.unpack, f", {at}"
        if self.header:
            code, offset_argument = HEADER_CODE + code, ""
            targets.insert(0, "head")
        unpack = self.structs.name("unpack_from", code)
        joined = ", ".join(targets) + ("," if len(targets) == 1 else "")
        out.append(Unpack(f"({joined})" if len(targets) == 1 else joined, f"{unpack}(raw{offset_argument})"))
        if self.header:
            self.header = False
            out.append(CheckHeader(HEADER_VALUE, self.records))
        out += blocks
        if needed and at == "pos":
            out.append(Move("+=", str(run.size)))

    def view(self, code: str, count: str, at: str, is_array: bool) -> str:
        self.uses_view = True
        return self.flavour.numbers(code, count, at, is_array=is_array)

    def count(self, ref: Ref, kind: FieldType, out: list[Statement]) -> str:
        """The number of elements; a bounded sequence's is checked here."""
        if kind.arity is Arity.ARRAY:
            return str(kind.capacity)
        if kind.arity is Arity.BOUNDED:
            self.support("check_max_length")
            out.append(CheckMaxLength(self.counts[ref], kind.capacity))
        return self.counts[ref]

    def text(self, step: StringContent, needed: bool, out: list[Statement]) -> None:
        at, count, target = self.at(step.start), self.counts[step.ref], self.attribute(step.ref)
        if step.type.base == "wstring":
            out.append(Assign(target, f"{self.support('from_utf16')}(raw, {at}, {count})"))
            if needed:
                self.move(at, f"{WSTRING_UNIT_BYTES} * {count}", out)
            return
        nul = f"pos + {count} - 1" if at == "pos" else f"{int(at) - 1} + {count}"
        out.append(ReadText(target, at, nul, self.bulk))
        self.late = needed

    def numbers(self, step: NumberArray, needed: bool, out: list[Statement]) -> None:
        count = self.count(step.ref, step.type, out)
        at = self.padded(step, count, out)
        out.append(Assign(self.attribute(step.ref), self.view(step.code, count, at, step.type.arity is Arity.ARRAY)))
        if needed and not _ends_known(step):
            size = f"{step.item_size} * {count}" if step.item_size > 1 else count
            if count.isdigit():
                size = str(step.item_size * int(count))
            self.move(at, size, out)

    def padded(self, step: NumberArray | Loop, count: str, out: list[Statement]) -> str:
        """Skip the padding that is only there when elements are; returns where the elements begin."""
        at = self.at(step.start)
        certain = step.type.arity is Arity.ARRAY
        if step.align > 1:
            self.align(step.align, "" if certain else count, out)
        elif step.pad and certain:
            if at != "pos":
                return plus(at, step.pad)
            out.append(Move("+=", str(step.pad)))
        elif step.pad:
            if at != "pos":
                out.append(Move("=", at))
            out.append(Align("pos", f"pos + {step.pad}", count))
            return "pos"
        return at

    def loop(self, step: Loop, needed: bool, out: list[Statement]) -> None:
        count = self.count(step.ref, step.type, out)
        if not step.fixed:
            self.messages(step, count, needed, out)
            return
        self.uses_view = True
        cls, at = self.classes[step.type.base], self.at(step.start)
        target = f"{self.attribute(step.ref)}, {'pos' if needed else '_'}"
        read = Assign(target, f"{self.support('read_records')}({cls}, view, {at}, {count})")
        otherwise: list[Statement] = []
        self.messages(step, count, needed, otherwise)
        out.append(IfElse("arrays", (read,), tuple(otherwise)))

    def messages(self, step: Loop, count: str, needed: bool, out: list[Statement]) -> None:
        """The elements as a list of messages."""
        values = self.names.name(step.ref.name)
        item = self.names.name(singular(step.ref.name))
        self.objects[step.number] = item
        cls = self.classes[step.type.base]
        self.support("new")
        new_list = NewList(self.attribute(step.ref), values, cls, "list")
        first: list[Statement] = [Assign(item, f"new({cls})"), AppendElement(values, item)]
        if step.mode is LoopMode.PACKED:
            self.packed(step, count, new_list, first, needed, out)
            return
        if step.start.static is not None:
            out.append(Move("=", self.at(step.start)))
        self.within(f"pos + {step.least} * {count}" if step.least > 1 else f"pos + {count}", out)
        out.append(new_list)
        if step.mode is LoopMode.CALL:
            body: list[Statement] = []
            self.outlined(item, step, step.type.base, True, body)
            body.append(AppendElement(values, item))
        else:
            body = first + self.scope(step.body, keep_pos=True)
        out.append(For("_", f"range({count})", tuple(body)))

    def within(self, end: str, out: list[Statement]) -> None:
        self.support("check_remaining")
        out.append(CheckRemaining(end))

    def packed(
        self, step: Loop, count: str, new_list: NewList, first: list[Statement], needed: bool, out: list[Statement]
    ) -> None:
        at = self.padded(step, count, out)
        run = next(inner for inner in step.body if isinstance(inner, PackedRun))
        blocks = [item for item in run.items if isinstance(item, FixedNumberArray)]
        if at != "pos" and blocks:
            out.append(Move("=", at))
            at = "pos"
        out.append(Assign("end", f"{at} + {step.stride} * {count}"))
        self.within("end", out)
        out.append(new_list)
        body = list(first)
        for inner in step.body:
            if isinstance(inner, InlineMessage):
                self.create(inner, body)
        targets: list[str] = []
        for item in run.items:
            if isinstance(item, Scalar):
                owner = self.objects[item.ref.owner]
                local = self.names.name(f"{owner}_{item.ref.name}")
                targets.append(local)
                body.append(Assign(self.attribute(item.ref), local))
        for block in blocks:
            view = self.view(block.code, str(block.length), plus("pos", block.offset), True)
            body.append(Assign(self.attribute(block.ref), view))
        if blocks:
            body.append(Move("+=", str(step.stride)))
        unpack = self.structs.name("iter_unpack", run.unpack)
        variables = f"({targets[0]},)" if len(targets) == 1 else ", ".join(targets) or "_"
        out.append(For(variables, f"{unpack}(memoryview(raw)[{at}:end])", tuple(body)))
        if needed and not blocks and not _ends_known(step):
            out.append(Move("=", "end"))


def _ends_known(step: NumberArray | Loop) -> bool:
    """Whether what follows knows its own place: behind an array of fixed size at a known one."""
    return step.type.arity is Arity.ARRAY and step.start.static is not None
