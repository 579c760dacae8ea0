"""Contents of a generated module, as values for the module template."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.descriptions import default_text
from rosidl_py_gen.base.names import RosName, py_name, snake_case
from rosidl_py_gen.cdr.message import ACTION_CLASSES, SERVICE_CLASSES
from rosidl_py_gen.compiler.codegen.decode import DecoderView, decoder_view
from rosidl_py_gen.compiler.codegen.encode import EncoderView, encoder_view
from rosidl_py_gen.compiler.codegen.naming import Imports, sort_key
from rosidl_py_gen.compiler.codegen.python_literals import py_string, visible
from rosidl_py_gen.compiler.codegen.pytypes import (
    SUPPORT,
    MemberView,
    constant_view,
    field_view,
    rclpy_defaults,
)
from rosidl_py_gen.compiler.codegen.statements import MessageApi, RclpyMessageApi, Structs
from rosidl_py_gen.compiler.frontend.model import (
    ActionDef,
    Interface,
    MessageDef,
    ServiceDef,
    derived_name,
    messages_of,
)

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner

_CDR = "rosidl_py_gen.cdr"
_RCLPY = "rosidl_py_gen.cdr.rclpy_messages.message"
_ACTION_IMPL = {"SendGoalService": "SendGoal", "GetResultService": "GetResult", "FeedbackMessage": "FeedbackMessage"}
_COMMON_ACTION_TYPES = (
    ("CancelGoalService", "action_msgs/srv/CancelGoal"),
    ("GoalStatusMessage", "action_msgs/msg/GoalStatusArray"),
)


class Target(NamedTuple):
    """Environment of a generated module: import paths of generated modules, existing classes, and type hashes.

    Attributes:
        root: prefix of the generated packages' import paths; empty, or ending in a dot.
        known: returns the module that already defines the class of a message, by full name; else None.
        hashes: returns the RIHS01 hash of a type, by full name.
    """

    root: str
    known: Callable[[str], str | None]
    hashes: Callable[[str], str]

    def module(self, full_name: str) -> str:
        """Return the import path of the module that defines the class of a message."""
        return self.known(full_name) or self.root + module_path(full_name)


def module_path(full_name: str) -> str:
    """Return the module path of an interface without the root: ``std_msgs/msg/Header`` -> ``std_msgs.msg._header``."""
    package, kind, name = full_name.split("/")
    return f"{package}.{kind}.{module_name(name)}"


def module_name(interface: str) -> str:
    """Return the file stem of an interface's module, which is private: users import the class from the package."""
    return "_" + snake_case(interface)


class MessageView(NamedTuple):
    """Message class as values for the module template.

    Attributes:
        name: names that the template's imports have inside the class, as a field may have the same name.
        slots, defaults: only for rclpy's API.
    """

    cls: str
    ros_name: str
    doc: tuple[str, ...]
    constants: tuple[MemberView, ...]
    fields: tuple[MemberView, ...]
    constructor: tuple[str, ...]
    type_info: str
    encoder: EncoderView
    decoder: DecoderView
    outlined: bool
    name: dict[str, str]
    slots: tuple[str, ...] | None = None
    defaults: str = ""


class GroupView(NamedTuple):
    """Service or action class as values for the module template; `impl` has the attributes of rclpy's `Impl`."""

    cls: str
    base: str
    parameters: str
    ros_name: str
    hash: str
    doc: tuple[str, ...]
    parts: tuple[tuple[str, str], ...]
    name: dict[str, str]
    impl: tuple[tuple[str, str], ...] | None = None


class ModuleView(NamedTuple):
    """Generated module as values for the module template."""

    ros_name: str
    type_checking: str
    imports: tuple[str, ...]
    typing_imports: tuple[str, ...]
    structs: tuple[tuple[str, str], ...]
    messages: tuple[MessageView, ...]
    groups: tuple[GroupView, ...]
    exports: tuple[str, ...]


def exported_names(interface: Interface) -> tuple[str, ...]:
    """Return the Python names of the public classes of an interface's module."""
    names = [message.name.name for message in messages_of(interface)]
    match interface:
        case ServiceDef():
            names.append(interface.name.name)
        case ActionDef():
            names += [interface.send_goal.name.name, interface.get_result.name.name, interface.name.name]
    return tuple(py_name(name) for name in names)


def module_view(interface: Interface, planner: LayoutPlanner, target: Target) -> ModuleView:
    """Return an interface's module as values for the module template."""
    messages = messages_of(interface)
    own = {str(message.name): py_name(message.name.name) for message in messages}
    fields = {py_name(item.name) for message in messages for item in message.fields}
    constants = {py_name(item.name) for message in messages for item in message.constants}
    imports = Imports(frozenset(exported_names(interface)), frozenset(fields | constants))
    structs = Structs()
    classes = dict(own)
    for base in sorted(_nested(messages, planner)):
        if base not in classes:
            classes[base] = imports.use(target.module(base), py_name(base.split("/")[2]))
    views = tuple(_message(message, planner, target, imports, structs, classes) for message in messages)
    groups = tuple(_groups(interface, imports, target, planner.rclpy))
    functions = _struct_functions(structs, imports)  # may add imports
    return ModuleView(
        str(interface.name),
        imports.use("typing", "TYPE_CHECKING"),
        tuple(imports.lines()),
        tuple(imports.lines(for_typing=True)),
        functions,
        views,
        groups,
        tuple(sorted(exported_names(interface), key=sort_key)),
    )


def _nested(messages: Iterable[MessageDef], planner: LayoutPlanner) -> set[str]:
    """Return the names of the message types that a module's code mentions: types of its fields, and types in inlined
    messages.
    """
    found = {item.type.base for message in messages for item in message.fields if item.type.is_message}
    in_line: set[str] = set()
    pending = [str(message.name) for message in messages]
    while pending:
        below = {item.type.base for item in planner.message(pending.pop()).fields if item.type.is_message}
        found |= below
        pending += (base for base in below - in_line if not planner.is_outlined(base))
        in_line |= below
    return found


def _message(
    message: MessageDef,
    planner: LayoutPlanner,
    target: Target,
    imports: Imports,
    structs: Structs,
    classes: dict[str, str],
) -> MessageView:
    full_name = str(message.name)
    name = _class_scope_names(imports, message, planner)
    fields: tuple[MemberView, ...] = ()
    if not planner.rclpy:
        fields = tuple(field_view(item, imports, classes, planner.is_fixed) for item in message.fields)
    constants = tuple(constant_view(item, imports, planner.rclpy) for item in message.constants)
    api = (RclpyMessageApi if planner.rclpy else MessageApi)(imports)
    plan = planner.plan(full_name)
    encoder = encoder_view(plan, api, structs, classes)
    decoder = decoder_view(plan, api, structs, classes)
    imports.use(SUPPORT, "viewable" if decoder.bulk else "readable", in_class=False)
    imports.use(SUPPORT, "new", in_class=False)
    slots = tuple(api.attribute(py_name(item.name)) for item in message.fields) if planner.rclpy else None
    return MessageView(
        classes[full_name],
        full_name,
        visible(message.comment) or (f"{full_name}.",),
        constants,
        fields,
        _constructor(fields),
        _type_info(message, imports, target.hashes(full_name), classes),
        encoder,
        decoder,
        planner.is_outlined(full_name),
        name,
        slots,
        rclpy_defaults(message.fields) if planner.rclpy else "",
    )


def _constructor(fields: tuple[MemberView, ...]) -> tuple[str, ...]:
    """Return the parameters of ``__init__`` for type checkers.

    The result is empty if the dataclass generates the same signature.
    """
    if all(item.accepted == item.annotation for item in fields):
        return ()
    this = "self" if all(item.name != "self" for item in fields) else "__self"
    return (this, *(f"{item.name}: {item.accepted} = ..." for item in fields))


def _type_info(message: MessageDef, imports: Imports, digest: str, classes: dict[str, str]) -> str:
    rows = [_table_row(item.name, str(item.type), classes.get(item.type.base)) for item in message.fields]
    table = "(\n" + "".join(f"        {row},\n" for row in rows) + "    )" if rows else "()"
    # As in a type description (docs/internals/protocol.md 3.4).
    explicit = (item for item in message.fields if item.default is not None)
    defaults = [f"{py_string(item.name)}: {py_string(default_text(item.default))}" for item in explicit]
    arguments = [f'"{message.name}"', f'"{digest}"', table, *(["{" + ", ".join(defaults) + "}"] if defaults else [])]
    lines = "".join(f"    {argument},\n" for argument in arguments)
    return f"{imports.use(_CDR, 'TypeInfo')}(\n{lines})"


def _table_row(name: str, kind: str, cls: str | None) -> str:
    if cls is None:
        return f'("{name}", "{kind}")'
    array = kind[kind.index("[") :] if "[" in kind else ""
    return f'("{name}", "{array}", {cls})' if array else f'("{name}", {cls})'


def _class_scope_names(imports: Imports, message: MessageDef, planner: LayoutPlanner) -> dict[str, str]:
    """Import the names that the template mentions inside a class; return the alias of each name in that class."""
    is_outlined = planner.is_outlined(str(message.name))
    names = {word: imports.use("typing", word) for word in ("ClassVar", "TYPE_CHECKING")}
    names["TypeInfo"] = imports.use(_CDR, "TypeInfo")
    if planner.rclpy:
        names["metaclass"] = imports.use(_RCLPY, "metaclass")
        names["base"] = imports.use(_RCLPY, "RclpyMessage")
    else:
        names["base"] = imports.use(_CDR, "Message")
        names["dataclass"] = imports.use("dataclasses", "dataclass")
    builtins = ("bool", "bytes", "classmethod") + (("int", "memoryview", "tuple", "bytearray") if is_outlined else ())
    names |= {word: imports.builtin(word) for word in builtins}
    if is_outlined:
        names["Append"] = imports.use(SUPPORT, "Append", for_typing=True)
    names["FastPathError"] = imports.use(SUPPORT, "FastPathError", in_class=False)
    for word in ("decode_slow", "encode_slow"):
        imports.use(_CDR, word, in_class=False)
    for word in ("Self", "Readable"):
        names[word] = imports.use(SUPPORT, word, for_typing=True)
    return names


def _struct_functions(structs: Structs, imports: Imports) -> tuple[tuple[str, str], ...]:
    functions: list[tuple[str, str]] = []
    for name, role, code, align, nul in structs:
        if align > 1:
            function = imports.use(SUPPORT, "packers", in_class=False)
            functions.append((name, f'{function}("{code}", {align}{", nul=True" if nul else ""})'))
        else:
            functions.append((name, f'{imports.use("struct", "Struct", in_class=False)}("<{code}").{role}'))
    return tuple(functions)


def _groups(interface: Interface, imports: Imports, target: Target, is_rclpy: bool) -> Iterable[GroupView]:
    def group(name: RosName, doc: tuple[str, ...], *, is_action: bool = False) -> GroupView:
        names = {
            "ClassVar": imports.use("typing", "ClassVar"),
            "TypeAlias": imports.use("typing", "TypeAlias", for_typing=True),
            "ServiceInfo": imports.use(_CDR, "ServiceInfo"),
        }
        suffixes = ACTION_CLASSES if is_action else SERVICE_CLASSES
        parts = {part: py_name(derived_name(name, part).name) for part in suffixes}
        base = "Action" if is_action else "Service"
        impl: dict[str, str] | None = None
        if is_rclpy:
            names["metaclass"] = imports.use(_RCLPY, "metaclass")
            impl = {one: parts[part] for one, part in _ACTION_IMPL.items()} if is_action else {}
            for part, full_name in _COMMON_ACTION_TYPES if is_action else ():
                impl[part] = imports.use(target.module(full_name), full_name.split("/")[2])
        return GroupView(
            py_name(name.name),
            imports.use(_RCLPY, f"Rclpy{base}") if is_rclpy else imports.use(_CDR, base),
            ", ".join([*parts.values()][: 3 if is_action else 2]),
            str(name),
            target.hashes(str(name)),
            visible(doc) or (f"{name}.",),
            tuple(parts.items()),
            names,
            None if impl is None else tuple(impl.items()),
        )

    match interface:
        case ServiceDef():
            yield group(interface.name, interface.request.comment)
        case ActionDef():
            for service, what in ((interface.send_goal, "sends a goal"), (interface.get_result, "returns the result")):
                yield group(service.name, (f"Service that {what} of {interface.name}.",))
            yield group(interface.name, interface.goal.comment, is_action=True)
