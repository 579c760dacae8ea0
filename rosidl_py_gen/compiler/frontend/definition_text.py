"""One interface of a search path: read and checked, and as text for people and for bags.

Decides how a definition looks when the types it uses are shown with it: below the line that names them, indented by a
tab, as `ros2 interface show` does it. Text is taken from the file as it stands; what comes from an .idl file, and the
messages ROS derives, are written in the notation of .msg files.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.descriptions import build_type_description, default_text
from rosidl_py_gen.base.names import KINDS, RosName, is_constant_name, is_field_name, split_ros_name
from rosidl_py_gen.compiler.frontend.missing import missing_interface
from rosidl_py_gen.compiler.frontend.model import ActionDef, FieldDef, MessageDef, ServiceDef
from rosidl_py_gen.compiler.frontend.registry import check, raise_diagnostics
from rosidl_py_gen.errors import DefinitionError, Diagnostic, TypeNotFoundError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.compiler.frontend.model import ConstantDef, Interface
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

MAX_LINES = 20_000
"""Types that use each other twice a level double the text with each level."""
_LINE = "=" * 80


def read_checked(registry: InterfaceRegistry, name: RosName) -> RosName:
    """Read what a name needs; returns the interface it belongs to: itself, or X for ``X_Request`` and the like.

    Raises:
        TypeNotFoundError: there is no such interface.
        DefinitionError: it, or something it uses, has problems.
    """
    owner = registry.owner(name)
    if owner is None:
        raise TypeNotFoundError(missing_interface(registry.search, name, f"no interface {name}"))
    check(registry, [owner])
    raise_diagnostics(registry)
    if not registry.knows(str(name)):
        raise TypeNotFoundError(missing_interface(registry.search, name, f"no interface {name}"))
    return owner


def full_name(search: SearchPath, text: str) -> RosName:
    """The interface a user means: ``pkg/msg/Name``, ``pkg/Name`` of any kind, or ``Name`` when one package has it.

    Raises:
        InvalidNameError: the text has another shape.
        TypeNotFoundError: several interfaces have that name.
    """
    if "/" in text:
        kinds = (kind for kind in KINDS if search.file(split_ros_name(text, kind)) is not None)
        return split_ros_name(text, next(kinds, "msg"))
    found = [name for package in search.packages.values() for name in package.files if name.name == text]
    if len(found) > 1:
        raise TypeNotFoundError(f'"{text}" may be {", ".join(map(str, found))}')
    return found[0] if found else split_ros_name(text)


def source_text(registry: InterfaceRegistry, owner: RosName) -> str:
    """The file's text, with a line break at the end."""
    text = _interface(registry, owner).source.text
    return text if text.endswith("\n") else text + "\n"


def full_text(registry: InterfaceRegistry, top: RosName) -> str:
    """ros2msg text as bags and MCAP files carry it; `compile_definition` reads it.

    What comes from .idl files is written in the notation of .msg files, the only one that most readers of bags know.
    With names that those do not allow it stays IDL below a line that says so; if the top one does, it is ros2idl text.
    """
    description = build_type_description(str(top), registry.field_rows)
    used = (split_ros_name(one["type_name"]) for one in description["referenced_type_descriptions"])
    parts = []
    for name in (top, *(name for name in used if name.kind == "msg")):
        if _stays_idl(registry, name):
            parts.append(f"{_LINE}\nIDL: {name}\n{source_text(registry, name)}")
        else:
            head = "" if name == top else f"{_LINE}\nMSG: {name.package}/{name.name}\n"
            parts.append(head + _file_text(registry, name))
    return "".join(parts)


def _stays_idl(registry: InterfaceRegistry, name: RosName) -> bool:
    interface = registry.interface(name)
    if interface is None or interface.source.format != "idl":
        return False
    sections = _sections(interface)
    fields = [item.name for section in sections for item in section.fields]
    constants = [item.name for section in sections for item in section.constants]
    return not (all(map(is_field_name, fields)) and all(map(is_constant_name, constants)))


def _file_text(registry: InterfaceRegistry, name: RosName) -> str:
    """The file's text; written anew for IDL, and for what no file has: messages that ROS derives, described types."""
    interface = registry.interface(name)
    if interface is not None and interface.source.text and interface.source.format != "idl":
        return source_text(registry, name)
    return "".join(f"{line}\n" for line, _ in _lines(registry, name))


def expanded_lines(
    registry: InterfaceRegistry, name: RosName, *, comments: bool = True, nested_comments: bool = False
) -> list[str]:
    """The definition, and below each field the definition of its type. Without comments there are no empty lines.

    Raises:
        DefinitionError: it would be more than `MAX_LINES`.
    """
    found: list[str] = []
    for line in _expanded(registry, name, comments, nested_comments):
        found.append(line)
        if len(found) > MAX_LINES:
            raise DefinitionError(
                Diagnostic(str(name), 0, 0, f"has more than {MAX_LINES} lines with all types it uses")
            )
    return found


def _expanded(registry: InterfaceRegistry, name: RosName, comments: bool, nested_comments: bool) -> Iterator[str]:
    for line, item in _lines(registry, name):
        code = line.partition("#")[0].rstrip()
        if comments or code:
            yield line if comments else code
        if item is not None and item.type.is_message:
            below = split_ros_name(item.type.base)
            for nested in _expanded(registry, below, nested_comments, nested_comments):
                yield f"\t{nested}"


def _interface(registry: InterfaceRegistry, name: RosName) -> Interface:
    interface = registry.interface(name)
    if interface is None:
        raise TypeNotFoundError(f"no interface {name}")
    return interface


def _lines(registry: InterfaceRegistry, name: RosName) -> Iterator[tuple[str, FieldDef | None]]:
    """The lines of a definition, each with the field it defines."""
    message = registry.message(str(name))
    interface = registry.interface(name)
    if interface is None or interface.source.format == "idl" or not interface.source.text:
        sections = _sections(interface) if interface is not None else [message] if message is not None else []
        for number, section in enumerate(sections):
            if number:
                yield "---", None
            yield from _written(section)
        return
    fields = {item.location.line: item for section in _sections(interface) for item in section.fields}
    for number, line in enumerate(interface.source.text.splitlines(), 1):
        yield line.rstrip(), fields.get(number)


def _sections(interface: Interface) -> list[MessageDef]:
    match interface:
        case MessageDef():
            return [interface]
        case ServiceDef():
            return [interface.request, interface.response]
        case ActionDef():
            return [interface.goal, interface.result, interface.feedback]


def _written(message: MessageDef) -> Iterator[tuple[str, FieldDef | None]]:
    """A message in the notation of .msg files."""
    for text in message.comment:
        yield f"# {text}".rstrip(), None
    for constant in message.constants:
        yield from _comment(constant)
        yield f"{constant.type} {constant.name}={default_text(constant.value)}", None
    for item in message.fields:
        yield from _comment(item)
        default = "" if item.default is None else f" {_default(item.default)}"
        kind = str(item.type).replace("/msg/", "/")
        yield f"{kind} {item.name}{default}", item


def _comment(element: FieldDef | ConstantDef) -> Iterator[tuple[str, None]]:
    unit = f" [{element.unit}]" if element.unit else ""
    lines = list(element.comment) or ([""] if unit else [])
    for number, text in enumerate(lines):
        yield f"# {text}{'' if number else unit}".replace("#  ", "# ").rstrip(), None


def _default(value: object) -> str:
    return str(list(value)) if isinstance(value, tuple) else repr(value)
