"""Everything the templates print, as values: one `ModuleView` per interface, one `PackageView` per package folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.names import RosName, py_name, snake_case
from rosidl_py_gen.compiler.codegen.decode import DecoderView, decoder_view
from rosidl_py_gen.compiler.codegen.encode import EncoderView, encoder_view
from rosidl_py_gen.compiler.codegen.message_api import Flavour, RclpyFlavour
from rosidl_py_gen.compiler.codegen.naming import Imports, sort_key
from rosidl_py_gen.compiler.codegen.python_literals import py_string, visible
from rosidl_py_gen.compiler.codegen.pytypes import (
    SUPPORT,
    ConstantView,
    FieldView,
    constant_view,
    defaults_text,
    field_view,
    rclpy_defaults,
)
from rosidl_py_gen.compiler.codegen.statements import Structs
from rosidl_py_gen.compiler.frontend.model import ActionDef, Interface, MessageDef, ServiceDef, messages_of

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner

_CDR = "rosidl_py_gen.cdr"
_RCLPY = "rosidl_py_gen.cdr.rclpy_messages.message"
_WIDE = "rosidl_py_gen.cdr.wide"
_OF_ALL_ACTIONS = (
    ("CancelGoalService", "action_msgs/srv/CancelGoal"),
    ("GoalStatusMessage", "action_msgs/msg/GoalStatusArray"),
)
_MAX_PRINTED = 1000
"""Fields, constants and values of default arrays up to which each is printed; beyond, they come from a table."""


class Target(NamedTuple):
    """Where generated modules live and which classes exist already.

    Attributes:
        root: prefix of the generated packages' import paths; empty, or ending in a dot.
        known: full message name -> module that already defines a class for it; that class is used instead of a twin.
        hashes: full name -> RIHS01.
        is_typed: type checkers may read the modules; False where they exist in memory only.
    """

    root: str
    known: Callable[[str], str | None]
    hashes: Callable[[str], str]
    is_typed: bool = True

    def module(self, full_name: str) -> str:
        """The module that defines the class of a message (its interface's module)."""
        return self.known(full_name) or self.root + module_path(full_name)


def module_path(full_name: str) -> str:
    """``std_msgs/msg/Header`` -> ``std_msgs.msg._header``; derived names lead to their interface."""
    package, kind, name = full_name.split("/")
    return f"{package}.{kind}.{module_name(name)}"


def module_name(interface: str) -> str:
    """The file stem for an interface; a leading underscore, because users import the class from the package."""
    return "_" + snake_case(interface)


class MessageView(NamedTuple):
    """One message class; `slots` and `defaults` are those of rclpy's flavour.

    Attributes:
        encoder, decoder: None in a class that walks its fields.
        name: what things are called in the class; `members`: the decorator that makes fields and constants of a table.
    """

    cls: str
    ros_name: str
    doc: tuple[str, ...]
    constants: tuple[ConstantView, ...]
    fields: tuple[FieldView, ...]
    constructor: tuple[str, ...]
    type_info: str
    encoder: EncoderView | None
    decoder: DecoderView | None
    outlined: bool
    name: dict[str, str]
    slots: tuple[str, ...] | None = None
    defaults: str = ""


class GroupView(NamedTuple):
    """A service or action class: no instances, only its parts as attributes; `impl`: of `Impl`, in rclpy's flavour."""

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
    """A generated module."""

    ros_name: str
    type_checking: str
    imports: tuple[str, ...]
    typing_imports: tuple[str, ...]
    structs: tuple[tuple[str, str], ...]
    messages: tuple[MessageView, ...]
    groups: tuple[GroupView, ...]
    exports: tuple[str, ...]


class AliasView(NamedTuple):
    """A module that hands on the classes of another one."""

    ros_name: str
    origin: str
    names: tuple[str, ...]


def exported_names(interface: Interface) -> tuple[str, ...]:
    """The public classes of an interface's module, as Python spells them."""
    names = [message.name.name for message in messages_of(interface)]
    match interface:
        case ServiceDef():
            names.append(interface.name.name)
        case ActionDef():
            names += [interface.send_goal.name.name, interface.get_result.name.name, interface.name.name]
    return tuple(py_name(name) for name in names)


def alias_view(interface: Interface, origin: str) -> AliasView:
    return AliasView(str(interface.name), origin, tuple(sorted(exported_names(interface), key=sort_key)))


def module_view(interface: Interface, layouts: LayoutPlanner, target: Target) -> ModuleView:
    """The module of one interface."""
    messages = messages_of(interface)
    own = {str(message.name): py_name(message.name.name) for message in messages}
    members: set[str] = set()
    for message in messages:
        members.update(py_name(item.name) for item in message.fields)
        members.update(py_name(item.name) for item in message.constants)
    imports = Imports(frozenset(exported_names(interface)), frozenset(members))
    structs = Structs.new()
    classes = dict(own)
    for base in sorted(_nested(messages, layouts)):
        if base not in classes:
            classes[base] = imports.use(target.module(base), py_name(base.split("/")[2]))
    views = tuple(_message(message, layouts, target, imports, structs, classes) for message in messages)
    groups = tuple(_groups(interface, imports, target))
    if layouts.rclpy:
        groups = tuple(_rclpy_group(group, imports, target) for group in groups)
    functions = _struct_functions(structs, imports)
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


def _nested(messages: Iterable[MessageDef], layouts: LayoutPlanner) -> set[str]:
    """Every message class the module's code mentions: direct fields, and what is written in line behind them."""
    found = {item.type.base for message in messages for item in message.fields if item.type.is_message}
    in_line: set[str] = set()
    pending = [str(message.name) for message in messages if not layouts.is_wide(str(message.name))]
    while pending:
        below = {item.type.base for item in layouts.message(pending.pop()).fields if item.type.is_message}
        found |= below
        pending += (base for base in below - in_line if not layouts.is_outlined(base))
        in_line |= below
    return found


def _message(
    message: MessageDef,
    layouts: LayoutPlanner,
    target: Target,
    imports: Imports,
    structs: Structs,
    classes: dict[str, str],
) -> MessageView:
    full_name = str(message.name)
    is_table = _is_table(message)
    name = _class_scope_names(imports, message, layouts)
    fields: tuple[FieldView, ...] = ()
    constants: tuple[ConstantView, ...] = ()
    if target.is_typed or not is_table:
        if not layouts.rclpy:
            fields = tuple(
                field_view(item, imports, classes, layouts.is_fixed, is_table=is_table) for item in message.fields
            )
        constants = tuple(constant_view(item, imports, layouts.rclpy) for item in message.constants)
    flavour = (RclpyFlavour if layouts.rclpy else Flavour)(imports)
    encoder = decoder = None
    if not layouts.is_wide(full_name):
        plan = layouts.plan(full_name)
        encoder = encoder_view(plan, flavour, structs, classes)
        decoder = decoder_view(plan, flavour, structs, classes)
        imports.use(SUPPORT, "viewable" if decoder.bulk else "readable", in_class=False)
        imports.use(SUPPORT, "new", in_class=False)
    slots = tuple(flavour.attribute(py_name(item.name)) for item in message.fields) if layouts.rclpy else None
    return MessageView(
        classes[full_name],
        full_name,
        visible(message.comment) or (f"{full_name}.",),
        constants,
        fields,
        _constructor(fields),
        (_wide_info if is_table else _type_info)(message, imports, target.hashes(full_name), classes),
        encoder,
        decoder,
        layouts.is_outlined(full_name),
        name,
        slots,
        rclpy_defaults(message.fields) if layouts.rclpy and not is_table else "",
    )


def _is_table(message: MessageDef) -> bool:
    values = sum(len(item.default) for item in message.fields if isinstance(item.default, tuple))
    return len(message.fields) + len(message.constants) + values > _MAX_PRINTED


def _constructor(fields: tuple[FieldView, ...]) -> tuple[str, ...]:
    """The parameters of ``__init__`` as type checkers shall see it; empty when the dataclass's own says the same."""
    if all(item.accepted == item.annotation for item in fields):
        return ()
    this = "self" if all(item.name != "self" for item in fields) else "__self"
    return (this, *(f"{item.name}: {item.accepted} = ..." for item in fields))


def _type_info(message: MessageDef, imports: Imports, digest: str, classes: dict[str, str]) -> str:
    rows = [_table_row(item.name, str(item.type), classes.get(item.type.base)) for item in message.fields]
    table = "(\n" + "".join(f"        {row},\n" for row in rows) + "    )" if rows else "()"
    defaults = [f"{py_string(key)}: {py_string(text)}" for key, text in defaults_text(message.fields)]
    arguments = [f'"{message.name}"', f'"{digest}"', table, *(["{" + ", ".join(defaults) + "}"] if defaults else [])]
    lines = "".join(f"    {argument},\n" for argument in arguments)
    return f"{imports.use(_CDR, 'TypeInfo')}(\n{lines})"


def _wide_info(message: MessageDef, imports: Imports, digest: str, classes: dict[str, str]) -> str:
    """The same with all fields and constants in one literal."""
    nested = {item.type.base: classes[item.type.base] for item in message.fields if item.type.is_message}
    numbers = {base: str(number) for number, base in enumerate(nested)}
    fields: list[tuple[object, ...]] = []
    for item in message.fields:
        base = item.type.base
        default = () if item.default is None else (item.default,)
        fields.append((item.name, str(item.type).replace(base, numbers.get(base, base), 1), *default))
    constants = [(item.name, item.type.base, item.value) for item in message.constants]
    table = json.dumps({"fields": fields, "constants": constants}, separators=(",", ":"))
    arguments = ", ".join([f'"{message.name}"', f'"{digest}"', py_string(table), *nested.values()])
    return f"{imports.use(_WIDE, 'WideInfo')}({arguments})"


def _table_row(name: str, kind: str, cls: str | None) -> str:
    if cls is None:
        return f'("{name}", "{kind}")'
    array = kind[kind.index("[") :] if "[" in kind else ""
    return f'("{name}", "{array}", {cls})' if array else f'("{name}", {cls})'


def _class_scope_names(imports: Imports, message: MessageDef, layouts: LayoutPlanner) -> dict[str, str]:
    """What the template itself mentions inside a class, as it is called there."""
    is_wide, heavy = (is_of(str(message.name)) for is_of in (layouts.is_wide, layouts.is_outlined))
    names = {word: imports.use("typing", word) for word in ("ClassVar", "TYPE_CHECKING")}
    names["TypeInfo"] = imports.use(_CDR, "TypeInfo")
    names["bases"] = imports.use(_WIDE, "WideMessage") if is_wide else ""
    if layouts.rclpy:
        names["metaclass"] = imports.use(_RCLPY, "metaclass")
        names["bases"] += ", " * is_wide + imports.use(_RCLPY, "RclpyMessage")
    else:
        names["bases"] = names["bases"] or imports.use(_CDR, "Message")
    names["members"] = ""
    if _is_table(message):
        names["Any"] = imports.use("typing", "Any", for_typing=True)
        wide = (_RCLPY, "wide_rclpy_message") if layouts.rclpy else (_WIDE, "wide_message")
        names["members"] = imports.use(*wide)
    elif not layouts.rclpy:
        names["dataclass"] = imports.use("dataclasses", "dataclass")
    if is_wide:
        return names
    builtins = ("bool", "bytes", "classmethod") + (("int", "memoryview", "tuple", "bytearray") if heavy else ())
    names |= {word: imports.builtin(word) for word in builtins}
    if heavy:
        names["Append"] = imports.use(SUPPORT, "Append", for_typing=True)
    names["FastPathError"] = imports.use(SUPPORT, "FastPathError", in_class=False)
    for word in ("decode_slow", "encode_slow"):
        imports.use(_CDR, word, in_class=False)
    for word in ("Self", "Readable"):
        names[word] = imports.use(SUPPORT, word, for_typing=True)
    return names


def _struct_functions(structs: Structs, imports: Imports) -> tuple[tuple[str, str], ...]:
    result: list[tuple[str, str]] = []
    for name, role, code, align, nul in structs:
        if align > 1:
            function = imports.use(SUPPORT, "packers", in_class=False)
            last = ", nul=True" if nul else ""
            result.append((name, f'{function}("{code}", {align}{last})'))
        else:
            result.append((name, f'{imports.use("struct", "Struct", in_class=False)}("<{code}").{role}'))
    return tuple(result)


def _groups(interface: Interface, imports: Imports, target: Target) -> Iterable[GroupView]:
    match interface:
        case ServiceDef():
            yield _service(interface, interface.request.comment, imports, target)
        case ActionDef():
            name = interface.name
            yield _service(interface.send_goal, (f"How a goal of {name} is sent.",), imports, target)
            yield _service(interface.get_result, (f"How the result of {name} is fetched.",), imports, target)
            yield _action(interface, imports, target)


def _group(
    name: RosName, base: str, parameters: int, parts: list[tuple[str, RosName]], doc: tuple[str, ...], imports: Imports,
    target: Target,
) -> GroupView:  # fmt: skip
    names = {
        "ClassVar": imports.use("typing", "ClassVar"),
        "TypeAlias": imports.use("typing", "TypeAlias", for_typing=True),
        "ServiceInfo": imports.use(_CDR, "ServiceInfo"),
    }
    spelled = [(part, py_name(full.name)) for part, full in parts]
    generic = ", ".join(cls for _, cls in spelled[:parameters])
    cls, base = py_name(name.name), imports.use(_CDR, base)
    return GroupView(cls, base, generic, str(name), target.hashes(str(name)), doc, tuple(spelled), names)


def _service(service: ServiceDef, doc: tuple[str, ...], imports: Imports, target: Target) -> GroupView:
    parts = [("Request", service.request.name), ("Response", service.response.name), ("Event", service.event.name)]
    return _group(service.name, "Service", 2, parts, visible(doc) or (f"{service.name}.",), imports, target)


def _action(action: ActionDef, imports: Imports, target: Target) -> GroupView:
    parts = [
        ("Goal", action.goal.name),
        ("Result", action.result.name),
        ("Feedback", action.feedback.name),
        ("FeedbackMessage", action.feedback_message.name),
        ("SendGoal", action.send_goal.name),
        ("GetResult", action.get_result.name),
    ]
    return _group(
        action.name, "Action", 3, parts, visible(action.goal.comment) or (f"{action.name}.",), imports, target
    )


def _rclpy_group(group: GroupView, imports: Imports, target: Target) -> GroupView:
    """The same group in rclpy's flavour."""
    names = {**group.name, "metaclass": imports.use(_RCLPY, "metaclass")}
    parts = dict(group.parts)
    impl: list[tuple[str, str]] = []
    if "Goal" in parts:
        impl = [("SendGoalService", parts["SendGoal"]), ("GetResultService", parts["GetResult"])]
        impl.append(("FeedbackMessage", parts["FeedbackMessage"]))
        for part, full_name in _OF_ALL_ACTIONS:
            impl.append((part, imports.use(target.module(full_name), full_name.split("/")[2])))
    base = imports.use(_RCLPY, "RclpyAction" if impl else "RclpyService")
    return group._replace(base=base, name=names, impl=tuple(impl))


class KindView(NamedTuple):
    """The ``__init__`` of ``<package>/<kind>``: every class, and the module it comes from when it is first used."""

    root: str
    package: str
    kind: str
    exports: tuple[tuple[str, str], ...]
    names: tuple[str, ...]


def kind_view(root: str, package: str, kind: str, interfaces: Iterable[tuple[RosName, tuple[str, ...]]]) -> KindView:
    exports = [(cls, module_name(name.name)) for name, classes in interfaces for cls in classes]
    names = tuple(sorted((cls for cls, _ in exports), key=sort_key))
    return KindView(
        root, package, kind, tuple(sorted(exports, key=lambda pair: (sort_key(pair[1]), sort_key(pair[0])))), names
    )
