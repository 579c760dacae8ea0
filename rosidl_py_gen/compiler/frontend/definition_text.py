"""Text of the definition of an interface, for display and for bags.

A definition with the types that it uses has these types below the fields, indented by a tab, as in `ros2 interface
show`. The text is the text of the file; definitions of .idl files and derived messages are converted to the notation of
.msg files.
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.model import FieldDef, MessageDef
from rosidl_py_gen.errors import DefinitionError, Diagnostic, TypeNotFoundError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.compiler.frontend.model import ConstantDef
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry

MAX_LINES = 20_000
"""Maximum lines of a definition that is displayed with all its types. Without a limit, types that each contain the next
type twice would double the text at every level."""
_SEPARATOR = "=" * 80


class DefinitionText:
    """Texts of the definition of a checked interface, for display and for bags."""

    def __init__(self, registry: InterfaceRegistry, name: RosName) -> None:
        self._registry, self._name = registry, name

    @property
    def source(self) -> str:
        """Text of the interface's file, with a line break at the end; raises `TypeNotFoundError`."""
        return _source(self._registry, self._name)

    @property
    def full(self) -> str:
        """ros2msg text of the interface and its types for bags and MCAP files; `compile_definition` reads the text.

        Definitions of .idl files are converted to the notation of .msg files, the only one that most readers of bags
        support. A definition with names that .msg files do not allow stays IDL below a header; if the interface itself
        has such names, the whole text is ros2idl text.
        """
        texts = []
        registry, top = self._registry, self._name
        for name in map(RosName.parse, registry.closure(str(top))):
            if name == top or name.kind == "msg":
                if _must_stay_idl(registry, name):
                    texts.append(f"{_SEPARATOR}\nIDL: {name}\n{_source(registry, name)}")
                else:
                    head = "" if name == top else f"{_SEPARATOR}\nMSG: {name.package}/{name.name}\n"
                    texts.append(head + _file_text(registry, name))
        return "".join(texts)

    def expanded_lines(self, *, comments: bool = True, nested_comments: bool = False) -> list[str]:
        """Return the lines of the definition; below a field of a message type follow the lines of that type, indented.

        Without comments there are no empty lines. Raises `DefinitionError` for more than `MAX_LINES`.
        """
        lines = [*islice(_expanded(self._registry, self._name, comments, nested_comments), MAX_LINES + 1)]
        if len(lines) > MAX_LINES:
            text = f"has more than {MAX_LINES} lines with all types it uses"
            raise DefinitionError(Diagnostic(str(self._name), 0, 0, text))
        return lines


def _source(registry: InterfaceRegistry, name: RosName) -> str:
    interface = registry.interface(name)
    if interface is None:
        raise TypeNotFoundError(f"no interface {name}")
    text = interface.source.text
    return text if text.endswith("\n") else text + "\n"


def _must_stay_idl(registry: InterfaceRegistry, name: RosName) -> bool:
    interface = registry.interface(name)
    if interface is None or interface.source.format != "idl":
        return False
    sections = interface.sections
    has_valid_fields = all(RosName.FIELD_RULE.allows(item.name) for section in sections for item in section.fields)
    return not (
        has_valid_fields
        and all(RosName.CONSTANT_RULE.allows(item.name) for section in sections for item in section.constants)
    )


def _file_text(registry: InterfaceRegistry, name: RosName) -> str:
    """Return the text of an interface's file; IDL, derived messages and type descriptions become .msg notation."""
    interface = registry.interface(name)
    if interface is not None and interface.source.text and interface.source.format != "idl":
        return _source(registry, name)
    return "".join(f"{line}\n" for line, _ in _lines(registry, name))


def _expanded(registry: InterfaceRegistry, name: RosName, comments: bool, nested_comments: bool) -> Iterator[str]:
    for line, item in _lines(registry, name):
        code = line.partition("#")[0].rstrip()
        if comments or code:
            yield line if comments else code
        if item is not None and item.type.is_message:
            below = RosName.parse(item.type.base)
            for nested in _expanded(registry, below, nested_comments, nested_comments):
                yield f"\t{nested}"


def _lines(registry: InterfaceRegistry, name: RosName) -> Iterator[tuple[str, FieldDef | None]]:
    """Yield the lines of a definition, each with the field that the line defines, or None."""
    message = registry.message(str(name))
    interface = registry.interface(name)
    if interface is None or interface.source.format == "idl" or not interface.source.text:
        sections = interface.sections if interface is not None else (message,) if message is not None else ()
        for number, section in enumerate(sections):
            if number:
                yield "---", None
            yield from _msg_lines(section)
        return
    fields = {item.location.line: item for section in interface.sections for item in section.fields}
    for number, line in enumerate(interface.source.text.splitlines(), 1):
        yield line.rstrip(), fields.get(number)


def _msg_lines(message: MessageDef) -> Iterator[tuple[str, FieldDef | None]]:
    for text in message.comment:
        yield f"# {text}".rstrip(), None
    for constant in message.constants:
        yield from _comment(constant)
        yield f"{constant.type} {constant.name}={constant.value_text}", None
    for item in message.fields:
        yield from _comment(item)
        value = list(item.default) if isinstance(item.default, tuple) else item.default
        default = "" if value is None else f" {value!r}"
        kind = str(item.type).replace("/msg/", "/")
        yield f"{kind} {item.name}{default}", item


def _comment(element: FieldDef | ConstantDef) -> Iterator[tuple[str, None]]:
    unit = f" [{element.unit}]" if element.unit else ""
    lines = list(element.comment) or ([""] if unit else [])
    for number, text in enumerate(lines):
        yield f"# {text}{'' if number else unit}".replace("#  ", "# ").rstrip(), None
