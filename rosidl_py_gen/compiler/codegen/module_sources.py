"""Python source of generated packages, rendered from checked definitions by jinja2 templates.

The views are the values for the templates: the contents of a module, and its fields and constants with annotation,
default value and docstring lines.

A wheel contains the templates in two forms: as text, and compiled by jinja2 (`hatch_build.py`). The texts are used if
the installed jinja2 cannot load the compiled templates. A source checkout has only the texts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import RosName, py_name
from rosidl_py_gen.base.resources import DataFolders, GeneratedCode
from rosidl_py_gen.cdr.message import NESTED_CLASSES
from rosidl_py_gen.compiler.codegen.decode import DecoderView, decoder_view
from rosidl_py_gen.compiler.codegen.encode import EncoderView, encoder_view
from rosidl_py_gen.compiler.codegen.layout_plan import LayoutPlanner
from rosidl_py_gen.compiler.codegen.python_text import Imports, docstring, py_literal, py_string, sort_key, visible
from rosidl_py_gen.compiler.codegen.statements import MessageApi, RclpyMessageApi, Structs
from rosidl_py_gen.compiler.frontend.model import (
    ActionDef,
    Interface,
    MessageDef,
    ServiceDef,
    derived_name,
)

if TYPE_CHECKING:
    from jinja2 import Environment

    from rosidl_py_gen.compiler.frontend.model import ConstantDef, FieldDef
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry

SUPPORT = "rosidl_py_gen.cdr.support"
_ZERO = {"bool": "False", "int": "0", "float": "0.0"}


class MemberView(NamedTuple):
    """Field or constant of a generated class, as values for the module template.

    Attributes:
        annotation: type of the attribute.
        accepted: type of the constructor's parameter: any sequence for numbers, also a structured array for messages of
            fixed size.
        ignore: a comment for type checkers.
    """

    name: str
    annotation: str
    value: str
    doc: tuple[str, ...]
    accepted: str = ""
    ignore: str = ""


def field_view(
    item: FieldDef, imports: Imports, classes: dict[str, str], is_fixed: Callable[[str], bool]
) -> MemberView:
    """Return the template values of a field."""
    kind = item.type
    name = py_name(item.name)
    # A field may have the name of a method of the base class, and then hides the method.
    ignore = "  # type: ignore[assignment]" if name in ("encode", "decode") else ""
    annotation = _annotation(kind, imports, classes)
    accepted = annotation
    if kind.primitive is not None and kind.arity is not Arity.SCALAR:
        accepted = imports.use(SUPPORT, kind.primitive.numpy.rstrip("_").capitalize() + "s", for_typing=True)
    elif kind.is_message and kind.arity is not Arity.SCALAR and is_fixed(kind.base):
        accepted = f"{annotation} | {imports.use(SUPPORT, 'Records', for_typing=True)}"
    return MemberView(name, annotation, _default(item, imports, classes), _doc(item), accepted, ignore)


def constant_view(item: ConstantDef, imports: Imports, rclpy: bool = False) -> MemberView:
    """Return the template values of a constant; with `rclpy`, a byte is bytes of length 1."""
    primitive = item.type.primitive
    is_bytes = rclpy and item.type.base == "byte"
    python = imports.builtin("bytes" if is_bytes else primitive.python if primitive else "str")
    annotation = f"{imports.use('typing', 'ClassVar')}[{python}]"
    value = _byte(item.value) if is_bytes else py_literal(item.value)
    return MemberView(py_name(item.name), annotation, value, _doc(item))


def _byte(value: object) -> str:
    assert isinstance(value, int)
    return repr(bytes([value]))


def rclpy_defaults(fields: tuple[FieldDef, ...]) -> str:
    """Return Python source of the default values for classes of rclpy's API: dictionary items by ROS name, with lists
    for arrays.
    """
    items = []
    for item in fields:
        spell = _byte if item.type.base == "byte" else py_literal
        if isinstance(item.default, tuple):
            items.append(f'"{item.name}": [{", ".join(map(spell, item.default))}]')
        elif item.default is not None:
            items.append(f'"{item.name}": {spell(item.default)}')
    return ", ".join(items)


def _doc(item: FieldDef | ConstantDef) -> tuple[str, ...]:
    lines = visible(item.comment)
    if item.unit:
        unit = f"[{item.unit}]"
        lines = (*lines[:-1], f"{lines[-1]} {unit}".strip()) if lines else (unit,)
    return visible(lines)


def _annotation(kind: FieldType, imports: Imports, classes: dict[str, str]) -> str:
    primitive = kind.primitive
    if primitive is not None and kind.arity is not Arity.SCALAR:
        array = imports.use("numpy.typing", "NDArray")
        return f"{array}[{imports.use('numpy', '')}.{primitive.numpy}]"
    if primitive is not None:
        base = imports.builtin(primitive.python)
    else:
        base = imports.builtin("str") if kind.is_string else classes[kind.base]
    return base if kind.arity is Arity.SCALAR else f"{imports.builtin('list')}[{base}]"


def _default(item: FieldDef, imports: Imports, classes: dict[str, str]) -> str:
    kind = item.type
    primitive = kind.primitive
    if kind.arity is Arity.SCALAR:
        if item.default is not None:
            assert not isinstance(item.default, tuple)
            return py_literal(item.default)
        if primitive is not None:
            return _ZERO[primitive.python]
        return '""' if kind.is_string else _factory(imports, classes[kind.base])
    if primitive is not None:
        return _factory(imports, f"lambda: {_array(item, imports)}")
    if isinstance(item.default, tuple) and item.default:
        return _factory(imports, f"lambda: [{', '.join(py_literal(value) for value in item.default)}]")
    if kind.arity is not Arity.ARRAY:
        return _factory(imports, imports.builtin("list"))
    if kind.is_string:
        return _factory(imports, f'lambda: [""] * {kind.capacity}')
    # The body of the lambda sees names of the module, not fields of the class.
    return _factory(imports, f"lambda: [{classes[kind.base]}() for _ in range({kind.capacity})]")


def _factory(imports: Imports, function: str) -> str:
    return f"{imports.use('dataclasses', 'field')}(default_factory={function})"


def _array(item: FieldDef, imports: Imports) -> str:
    primitive = item.type.primitive
    assert primitive is not None
    np = imports.use("numpy", "")
    dtype = f"{np}.{primitive.numpy}"
    if isinstance(item.default, tuple) and item.default:
        return f"{np}.array([{', '.join(py_literal(value) for value in item.default)}], {dtype})"
    return f"{np}.zeros({item.type.capacity if item.type.arity is Arity.ARRAY else 0}, {dtype})"


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
    name = RosName(*full_name.split("/"))
    return f"{name.package}.{name.kind}.{name.module_name}"


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
    names = [message.name.name for message in interface.messages]
    match interface:
        case ServiceDef():
            names.append(interface.name.name)
        case ActionDef():
            names += [interface.send_goal.name.name, interface.get_result.name.name, interface.name.name]
    return tuple(py_name(name) for name in names)


def module_view(interface: Interface, planner: LayoutPlanner, target: Target) -> ModuleView:
    """Return an interface's module as values for the module template."""
    messages = interface.messages
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
    defaults = [f"{py_string(item.name)}: {py_string(item.default_text)}" for item in explicit]
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
        base = "Action" if is_action else "Service"
        parts = {part: py_name(derived_name(name, part).name) for part in NESTED_CLASSES[base]}
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


def environment_of_texts() -> Environment:
    """Return a jinja2 environment, with the filters of the templates, that loads the texts of the templates instead of
    compiled ones.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

    environment = Environment(
        loader=FileSystemLoader(DataFolders.templates()),
        undefined=StrictUndefined,
        autoescape=select_autoescape(()),  # Python, not HTML; literals pass through `string` and `docstring`
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "docstring": lambda lines, indent: docstring(lines, " " * indent),
        "string": py_string,
        "code": _indented,
    }
    return environment


def _indented(text: str, indent: int = 0) -> str:
    return "\n".join(" " * indent + line if line.strip() else "" for line in text.splitlines())


@lru_cache(maxsize=1)
def _environment() -> Environment:
    from jinja2 import ChoiceLoader, ModuleLoader  # takes 30 ms to import

    environment = environment_of_texts()
    assert environment.loader is not None
    compiled = ModuleLoader(Path(__file__).parents[2] / "compiled_templates")  # in wheels only
    environment.loader = ChoiceLoader([compiled, environment.loader])
    return environment


def render(template: str, **values: object) -> str:
    """Return the text of the template with this name, rendered with the values as its variables."""
    return _environment().get_template(template).render(values)


def module_source(registry: InterfaceRegistry, name: RosName, planner: LayoutPlanner, target: Target) -> str:
    """Return the source of an interface's module; the interface and all types that it refers to must be valid."""
    interface = registry.interface(name)
    assert interface is not None, name
    origin = target.known(str(name))
    if origin is None:
        return render("module.py.jinja", module=module_view(interface, planner, target))
    names = sorted(exported_names(interface), key=sort_key)
    return render("alias.py.jinja", ros_name=str(name), origin=origin, names=names)


class ModuleSources:
    """Sources of the modules of checked interfaces in a registry; the layout of each message is planned once.

    With `rclpy`, the classes have the API of rclpy's classes.
    """

    def __init__(self, registry: InterfaceRegistry, *, rclpy: bool = False) -> None:
        self._registry = registry
        self._planner = LayoutPlanner(registry.message, rclpy=rclpy)

    def module(
        self, name: RosName, root: str = "", known: Callable[[str], str | None] = lambda full_name: None
    ) -> tuple[str, str]:
        """Return the import path and the source of an interface's module.

        Args:
            name: the interface; it and all types that it refers to must be valid.
            root: prefix of import paths; empty, or ending in a dot.
            known: returns the module that already defines the class of another message, by full name; else None.
        """
        interface = self._registry.interface(name)
        assert interface is not None, name
        own = {str(name), *(str(message.name) for message in interface.messages)}
        target = Target(root, lambda one: None if one in own else known(one), self._registry.type_hash)
        return root + module_path(str(name)), module_source(self._registry, name, self._planner, target)

    @staticmethod
    def preload() -> None:
        """Import jinja2 and load the module template, to save time when the first module is rendered."""
        _environment().get_template("module.py.jinja")


def package_sources(
    registry: InterfaceRegistry,
    names: Iterable[RosName],
    target: Target,
    progress: Callable[[RosName], object] = lambda name: None,
) -> dict[str, str]:
    """Return the source files of the packages of valid interfaces, as a dictionary from relative path to text.

    Args:
        progress: called with the name of each interface before its module is rendered.
    """
    planner = LayoutPlanner(registry.message)
    files: dict[str, str] = {}
    exports: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for name in names:
        progress(name)
        module = name.module_name
        files[f"{name.package}/{name.kind}/{module}.py"] = module_source(registry, name, planner, target)
        interface = registry.interface(name)
        assert interface is not None
        classes = exports.setdefault((name.package, name.kind), [])
        classes += [(cls, module) for cls in exported_names(interface)]
    for (package, kind), classes in exports.items():
        files[f"{package}/{kind}/__init__.py"] = render(
            "kind_init.py.jinja",
            root=target.root,
            package=package,
            kind=kind,
            exports=sorted(classes, key=lambda row: (sort_key(row[1]), sort_key(row[0]))),
            names=sorted((cls for cls, _ in classes), key=sort_key),
        )
        files[f"{package}/__init__.py"] = render("package_init.py.jinja", package=package)
        files[f"{package}/py.typed"] = f"{GeneratedCode.HEADER}: the package is typed (PEP 561). Do not edit.\n"
    return dict(sorted(files.items()))
