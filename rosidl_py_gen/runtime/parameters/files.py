"""Reader and writer of parameter files, in the YAML dialect of rcl.

Scalars differ from YAML: `y` is true, `010` is 8, `08` is 8.0 and `null` is a string. So the YAML library only
separates plain from quoted scalars, and `plain_scalar` converts plain scalars. Scalars that are quoted or tagged
``!!str`` are strings; other tags and anchors are ignored (``!!int yes`` is true), and block scalars count as plain, as
in `get_value` of parse.c of rcl_yaml_param_parser. With Lyrical and later, ``!!bool``, ``!!int`` and ``!!float`` decide
about the type.

Files are read event by event, as rcl does, because the results of rcl do not always follow the structure of the maps.

Lines are written without the emitter of PyYAML, which takes one second for each MB of a long text, and recurses for
each level. Each value is on one line; scalars are plain if that is unambiguous, else in double quotes with JSON
escapes. Source: docs/internals/protocol.md 10.5.
"""

from __future__ import annotations

import base64
import heapq
import json
import math
import re
import sys
from typing import TYPE_CHECKING, NoReturn

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.yaml_text import YamlError, YamlText
from rosidl_py_gen.runtime.names import find_namespace_fault, find_node_name_fault
from rosidl_py_gen.runtime.parameters.initial_values import ParameterFileError, ParameterOverrides
from rosidl_py_gen.runtime.parameters.values import (
    INT64_MAX,
    INT64_MIN,
    InvalidParameterValueError,
    ParameterType,
    ParameterValue,
    PythonValue,
    parameter_value,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

try:
    import yaml
except ModuleNotFoundError as missing:
    raise Extra.missing_error(missing) or missing from None


PARAMETERS_KEY = "ros__parameters"
_BINARY, _STRING = "tag:yaml.org,2002:binary", "tag:yaml.org,2002:str"
_TYPE_TAGS = {
    "tag:yaml.org,2002:bool": ParameterType.BOOL,
    "tag:yaml.org,2002:int": ParameterType.INTEGER,
    "tag:yaml.org,2002:float": ParameterType.DOUBLE,
}
"""Types of parameters by the YAML tags that rcl obeys since Lyrical."""
_MAX_LEVELS = 500
"""Maximum depth of nested maps in a parameter file (names of nodes and groups); rcl has no limit."""
_MAX_BYTES = 1 << 28
"""Maximum size of a parameter file: `dump_parameters` may write large texts, such as maps."""
_NAMESPACE_TOKEN = re.compile(r"[A-Za-z_]\w{0,199}\Z", re.ASCII)
"""Regular expression for a valid part of a namespace; longer parts may be valid as well."""
_MAX_NAME_CHARACTERS = 1 << 26
"""Maximum length of all names of nodes and parameters of a file together. It is limited because nested maps repeat the
names of groups."""
_TRUE = frozenset(["y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"])
_FALSE = frozenset(["n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"])
_INTEGER = re.compile(r"[+-]?(?:(?P<hex>0[xX][0-9a-fA-F]+)|(?P<octal>0[0-7]*)|(?P<decimal>[1-9][0-9]*))\Z")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?\Z")
_HEX_FLOAT = re.compile(r"[+-]?0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][+-]?[0-9]+)?\Z")
_NAN = re.compile(r"(?:\.nan|\.NaN|\.NAN|[+-]?[nN][aA][nN])\Z")
_INFINITE = re.compile(r"(?P<sign>[+-]?)(?:\.inf|\.Inf|\.INF|[iI][nN][fF](?:[iI][nN][iI][tT][yY])?)\Z")
_MAX_WRITTEN_LEVELS = 16
"""Maximum depth of maps that `dump_parameters` writes below a node; the rest of a longer name is one key with dots."""
_MAX_SIMPLE_KEY = 900
"""Maximum length of a key before a colon; longer keys follow a question mark. libyaml reads up to 1024 characters."""
_PLAIN = re.compile(r"[A-Za-z_/](?:[\w./+ -]{0,300}[\w./+-])?\Z", re.ASCII)
"""Regular expression for a string that has the same meaning in YAML with and without quotes, also in a list."""


# ----------------------------------------------------------------------------------------------------------- scalars


def plain_scalar(text: str) -> ParameterValue:
    """Return the parameter value that rcl reads from an unquoted scalar of YAML.

    Raises:
        InvalidParameterValueError: the scalar is empty.
    """
    if not text:
        raise InvalidParameterValueError("empty value; write '' for an empty string")
    if text in _TRUE or text in _FALSE:
        return ParameterValue(ParameterType.BOOL, text in _TRUE)
    integer = _INTEGER.match(text)
    if integer and (integer["decimal"] is None or len(text) <= 70):  # CPython refuses thousands of decimal digits
        number = int(text, 16 if integer["hex"] else 8 if integer["octal"] else 10)
        if INT64_MIN <= number <= INT64_MAX:
            return ParameterValue(ParameterType.INTEGER, number)
    real = _float(text)
    if real is not None:
        return ParameterValue(ParameterType.DOUBLE, real)
    return ParameterValue(ParameterType.STRING, text)


def _float(text: str) -> float | None:
    """Convert a text to a number like C's strtod, which also reads ``.nan`` and ``.inf``.

    Returns None if the text is not a number, or the number is out of range.
    """
    infinite = _INFINITE.match(text)
    if infinite:
        return -math.inf if infinite["sign"] == "-" else math.inf
    if _NAN.match(text):
        return math.nan
    try:
        value = float(text) if _FLOAT.match(text) else float.fromhex(text) if _HEX_FLOAT.match(text) else None
    except OverflowError:
        return None
    return None if value is None or math.isinf(value) or underflows(text, value) else value


def underflows(text: str, value: float) -> bool:
    """Return True if glibc's strtod reports ERANGE for a tiny number, so that rcl reads the number as a string.

    That happens if digits are lost: for ``1e-310`` and ``1e-400``, not for ``0e-400``. A hexadecimal number counts as
    exact unless it becomes zero.

    Args:
        text: number as written.
        value: converted number.
    """
    is_hex = "x" in text.lower()
    digits = text.lower().partition("p" if is_hex else "e")[0].strip("+-0x.")
    return digits != "" and (value == 0.0 or (abs(value) < sys.float_info.min and not is_hex))


# ----------------------------------------------------------------------------------------------------------- reading


def parse_parameter_file(text: str, name: str = "<text>") -> list[ParameterOverrides]:
    """Parse the text of a parameter file.

    Returns the values by node key, the name or pattern of nodes to which they apply.

    Args:
        text: contents of the file.
        name: name of the file for error texts.

    Raises:
        ParameterFileError: the text is not a parameter file; the error contains line and column.
    """
    table = ParameterTable()
    table.read_file(text, name)
    return table.overrides()


def read_parameter_file(path: Path) -> list[ParameterOverrides]:
    """Read and parse a parameter file; return the values by node key, the name or pattern of nodes to which they apply.

    Raises:
        ParameterFileError: the file is not a parameter file, or not in UTF-8.
        OSError: the file cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ParameterFileError(f"{path}: expected UTF-8, found the byte {error.object[error.start]:#04x}") from None
    return parse_parameter_file(text, str(path))


def parse_parameter_value(text: str) -> ParameterValue:
    """Parse the value of a ``-p name:=value`` argument, a scalar or a list.

    Raises:
        ParameterFileError: the text is neither a scalar nor a list.
    """
    table = ParameterTable()
    table.read_argument("/**", "value", text, "<value>")
    return table.overrides()[0].values["value"]


class ParameterTable:
    """Parameters of nodes from files and ``-p`` arguments, combined as rcl combines them.

    A node key is a name of a node, or a pattern such as ``/**``, to which values apply.

    - Later values replace earlier ones for the same node key. rcl has one slot for each type, so a later value of
      another type is read only if its type precedes the other type in `_PRECEDENCE`.
    - Node keys are compared as they are written: ``show`` and ``/show`` are two. `overrides` returns the keys in the
      order of their first appearance; of several keys that match a node, the last one wins.
    """

    def __init__(self) -> None:
        self._nodes: dict[str, _NodeValues] = {}

    def read_file(self, text: str, name: str) -> None:
        """Add the parameters in the text of a parameter file.

        Args:
            text: contents of the file.
            name: name of the file for errors and warnings.

        Raises:
            ParameterFileError: the text is not a parameter file.
        """
        reader = _FileReader(name, self.node)
        try:
            for event in YamlText(text, max_bytes=_MAX_BYTES, max_levels=_MAX_LEVELS).events():
                reader.read(event)
        except YamlError as error:
            raise ParameterFileError(error.at(name)) from None

    def read_argument(self, key: str, parameter: str, text: str, source: str) -> None:
        """Add the value of a ``-p`` argument.

        Args:
            key: node key; ``/**`` for all nodes.
            parameter: name of the parameter.
            text: value, a scalar or a list in YAML.
            source: the argument, for warnings.

        Raises:
            ParameterFileError: the text is neither a scalar nor a list.
        """
        slot = self.node(key, source).slot(parameter)
        reader = _ValueReader("<value>", slot)
        try:
            for event in YamlText(text, max_bytes=_MAX_BYTES, max_levels=_MAX_LEVELS).events():
                if isinstance(event, yaml.MappingStartEvent) and not reader.is_in_list:
                    _fail("<value>", event, "expected a value or a list, found a map")
                reader.read(event)
        except YamlError as error:
            raise ParameterFileError(error.at("<value>")) from None
        if not reader.has_value:
            raise ParameterFileError("<value>: empty value; for an empty string write \"''\" in a shell")

    def node(self, key: str, source: str) -> _NodeValues:
        """Return the collection of values for a node key.

        Values added to it are recorded with `source`, a file or argument.
        """
        node = self._nodes.setdefault(key, _NodeValues(key))
        node.sources.setdefault(source)
        node.source = source
        return node

    def overrides(self) -> list[ParameterOverrides]:
        """Return the values that rcl would read, for each node key and each source (file or argument) with that key."""
        overrides: list[ParameterOverrides] = []
        for node in self._nodes.values():
            values: dict[str, dict[str, ParameterValue]] = {source: {} for source in node.sources}
            for name, slot in node.by_name().items():
                value, source = slot.value_and_source()
                values[source][name] = value
            overrides += (ParameterOverrides(f"/{node.key.removeprefix('/')}", values[one], one) for one in values)
        return overrides

    def warnings(self) -> list[str]:
        """Return a sentence for each value that rcl would ignore because of an earlier value of another type."""
        return [
            f"{source} sets the parameter {name} = {value.value!r:.100} of {node.key}, which is ignored as in rcl: "
            f"{used_source} has {used.value!r:.100} of another type; give all values of a parameter the same type"
            for node in self._nodes.values()
            for name, slot in node.by_name().items()
            for value, source in slot.ignored()
            for used, used_source in (slot.value_and_source(),)
        ]


class _Slot:
    """Values of one parameter name as rcl stores them: one value for each type, each with its source (file or
    argument).
    """

    def __init__(self, node: _NodeValues) -> None:
        self._node = node
        self._source = node.source
        self._values: dict[ParameterType, tuple[ParameterValue, str]] = {}
        self._is_empty_list = False

    def set(self, value: ParameterValue) -> None:
        self._values.pop(value.type, None)
        self._values[value.type] = value, self._node.source

    def set_empty_list(self) -> None:
        """Record an empty list, which leaves another value of the parameter in place, as in rcl."""
        self._is_empty_list = True

    def value_and_source(self) -> tuple[ParameterValue, str]:
        """Return the value that rcl reads, and its source.

        If there is no value, the result is an empty list or, for an empty map, NOT_SET.
        """
        for type_ in _PRECEDENCE:
            if type_ in self._values:
                return self._values[type_]
        return parameter_value([]) if self._is_empty_list else ParameterValue(), self._source

    def ignored(self) -> list[tuple[ParameterValue, str]]:
        """Return a list of the last value and its source if rcl ignores it and reads another value.

        Returns an empty list otherwise.
        """
        last = list(self._values.values())[-1:]
        return [] if last == [self.value_and_source()] else last


_PRECEDENCE = (
    ParameterType.BOOL,
    ParameterType.INTEGER,
    ParameterType.DOUBLE,
    ParameterType.STRING,
    ParameterType.BYTE_ARRAY,
    ParameterType.BOOL_ARRAY,
    ParameterType.INTEGER_ARRAY,
    ParameterType.DOUBLE_ARRAY,
    ParameterType.STRING_ARRAY,
)
"""Types in the order in which rclpy's `_parameter_from_rcl_variant` searches for the value of a parameter."""


class _NodeValues:
    """Parameters for one node key in files and arguments.

    rcl stores a list of slots (one for each parameter name). The slot of a group gets the name of the group's first
    parameter, and the next parameter of the group gets a new slot. So names in groups may appear twice, and the later
    slot wins.

    Attributes:
        key: node key as it is written.
        sources: files and arguments with the key, in order.
        source: the current file or argument.
    """

    def __init__(self, key: str) -> None:
        self.key = key
        self.sources: dict[str, None] = {}
        self.source = ""
        self._names: list[str] = []
        self._slots: list[_Slot] = []
        self._indexes: dict[str, list[int]] = {}
        """Indexes of all slots with a name, as a heap for each name."""

    def slot(self, name: str) -> _Slot:
        """Return the first slot with a name, after adding one if there is none."""
        return self._slots[self._index(name)]

    def member_slot(self, group: str, name: str) -> tuple[str, _Slot]:
        """Rename the first slot of a group to the name of a member of the group, as rcl does.

        Returns full name and slot. If the group has no slot, a slot is added.
        """
        index = self._index(group)
        heapq.heappop(self._indexes[group])
        member = self._names[index] = f"{group}.{name}"
        heapq.heappush(self._indexes.setdefault(member, []), index)
        return member, self._slots[index]

    def _index(self, name: str) -> int:
        indexes = self._indexes.setdefault(name, [])
        if not indexes:
            indexes.append(len(self._slots))
            self._names.append(name)
            self._slots.append(_Slot(self))
        return indexes[0]

    def by_name(self) -> dict[str, _Slot]:
        return dict(zip(self._names, self._slots, strict=True))


class _Path:
    """Names of nested maps joined to one text, with the rules of namespace.c of rcl_yaml_param_parser.

    `pop` cuts the text at the last separator; if a name itself contains a separator, only its last part is removed.
    """

    def __init__(self, separator: str) -> None:
        self._separator = separator
        self.text = ""
        self.count = 0

    def push(self, name: str) -> None:
        if self.count and not self.text.endswith(self._separator):
            name = self._separator + name
        self.text, self.count = self.text + name if self.count else name, self.count + 1

    def replace(self, text: str) -> None:
        """Replace the joined names by `text`, and increment the counter of names."""
        self.text, self.count = text, self.count + 1

    def pop(self) -> None:
        if self.count:
            self.count -= 1
            if not self.count:
                self.text = ""
            elif self._separator in self.text:
                self.text = self.text.rpartition(self._separator)[0]


class _ValueReader:
    """Reader of the YAML events of one parameter value, a scalar or a list, into a slot."""

    def __init__(self, file_name: str, slot: _Slot) -> None:
        self._file_name = file_name
        self.slot = slot
        self._list_start: yaml.Event | None = None
        self._items: list[PythonValue] = []
        self.has_value = False

    @property
    def is_in_list(self) -> bool:
        return self._list_start is not None

    def read(self, event: yaml.Event) -> bool:
        """Process the next YAML event of the value; return True if the value is complete."""
        if isinstance(event, yaml.ScalarEvent):
            try:
                if self._list_start is None:
                    self.slot.set(_bytes(event) or _scalar(event))
                else:
                    self._items.append(_scalar(event).value)
            except InvalidParameterValueError as error:
                _fail(self._file_name, event, str(error))
        elif isinstance(event, yaml.CollectionStartEvent):
            if self._list_start is not None:
                _fail(self._file_name, event, "a list must contain scalars only")
            self._list_start = event
            self._items = []
        elif isinstance(event, yaml.SequenceEndEvent):
            self._end_list()
        else:
            return False
        self.has_value = True
        return self._list_start is None

    def _end_list(self) -> None:
        start, self._list_start = self._list_start, None
        if not self._items:
            self.slot.set_empty_list()
            return
        try:
            self.slot.set(parameter_value(self._items))
        except InvalidParameterValueError as error:
            assert start is not None
            _fail(self._file_name, start, str(error))


class _FileReader:
    """Reader of parameter files that imitates the state of rcl's reader between YAML events.

    The state remains at the ends of YAML documents. The reader follows `parse_file_events` and `parse_key` of
    rcl_yaml_param_parser, whose results differ from the structure of the maps for names that contain separators. Lists
    in lists, maps in lists, and empty maps before other parameters are refused, because rcl misreads them. Source:
    docs/internals/protocol.md 10.5.
    """

    def __init__(self, file_name: str, find_node: Callable[[str, str], _NodeValues]) -> None:
        self._file_name = file_name
        self._find_node = find_node
        self._names, self._groups = _Path("/"), _Path(".")
        self._depth = 0
        self._section_depth: int | None = None
        """Depth of the map below the key ``ros__parameters``, while that map is open."""
        self._is_in_section = False
        """True while rcl takes keys for names of parameters; False already after an empty map, as in rcl."""
        self._section_key: yaml.ScalarEvent | None = None
        """Event of the key ``ros__parameters`` if the next event must begin the map for this key."""
        self._is_key = True
        self._is_new_map = False
        self._map_start: yaml.Event | None = None
        self._node: _NodeValues | None = None
        self._parameter = ""
        self._value: _ValueReader | None = None
        self._empty_map: yaml.Event | None = None
        self._name_characters = 0

    def read(self, event: yaml.Event) -> None:
        if isinstance(event, yaml.NodeEvent):
            if self._empty_map is not None:
                self._fail(self._empty_map, "an empty map must be the last entry below the node; remove it")
            if self._value is not None and self._value.is_in_list:
                self._value.read(event)
                return
            if self._section_key is not None and not isinstance(event, yaml.MappingStartEvent):
                self._fail(event, f"expected parameter names with values below {self._section_key.value}")
            if isinstance(event, yaml.MappingStartEvent):
                self._start_map(event)
            elif not self._is_key:
                self._read_value(event)
            elif isinstance(event, yaml.ScalarEvent):
                self._read_key(event)
            else:
                self._fail(event, "a key must be a string" if self._depth else "expected node names, found a list")
        elif isinstance(event, yaml.SequenceEndEvent):
            assert self._value is not None
            self._is_key = self._value.read(event)
        elif isinstance(event, yaml.MappingEndEvent):
            self._end_map(event)

    def _fail(self, event: yaml.Event, text: str) -> NoReturn:
        _fail(self._file_name, event, text)

    def _count_name(self, event: yaml.Event, name: str) -> None:
        self._name_characters += len(name)
        if self._name_characters > _MAX_NAME_CHARACTERS:
            self._fail(event, f"all names together have more than {_MAX_NAME_CHARACTERS} characters")

    def _start_map(self, event: yaml.Event) -> None:
        if self._is_key is (self._depth > 0):
            self._fail(event, "a key must be a string" if self._depth else "expected no text before the node names")
        self._depth += 1
        self._is_key = True
        self._is_new_map = self._section_key is None
        self._map_start = event
        if self._section_key is not None:
            self._section_key, self._section_depth = None, self._depth

    def _end_map(self, event: yaml.Event) -> None:
        if self._depth == self._section_depth:
            self._section_depth = self._empty_map = None
        elif self._is_in_section and self._is_new_map:
            self._empty_map = self._map_start
        if not self._is_in_section:
            if self._depth == self._names.count + 1:
                self._names.pop()
        elif self._groups.count:
            self._groups.pop()
        else:
            self._is_in_section = False
        self._depth -= 1

    def _read_key(self, event: yaml.ScalarEvent) -> None:
        if not event.value:
            self._fail(event, "a key must not be empty")
        self._is_key = False
        if self._is_in_section:
            self._read_parameter_name(event)
        elif event.value.startswith(PARAMETERS_KEY):
            if not self._names.count:
                self._fail(event, f"{PARAMETERS_KEY} must be below the name of a node")
            if reason := node_key_fault(self._names.text):
                self._fail(event, f"the node key {self._names.text!r:.300} is invalid: {reason}")
            self._node = self._find_node(self._names.text, self._file_name)
            self._section_key, self._is_in_section = event, True
        else:
            self._names.push(event.value)
            self._count_name(event, self._names.text)

    def _read_parameter_name(self, event: yaml.ScalarEvent) -> None:
        assert self._node is not None
        if self._is_new_map:
            self._groups.replace(self._parameter)
            self._is_new_map = False
        if self._groups.count:
            self._parameter, slot = self._node.member_slot(self._groups.text, event.value)
        else:
            self._parameter, slot = event.value, self._node.slot(event.value)
        self._count_name(event, self._parameter)
        self._value = _ValueReader(self._file_name, slot)

    def _read_value(self, event: yaml.Event) -> None:
        if not self._depth:
            self._fail(event, "expected node names with parameters below them")
        if not self._is_in_section:
            self._fail(event, f"expected {PARAMETERS_KEY} below {self._names.text!r:.300}, found a value")
        assert self._value is not None
        self._is_key = self._value.read(event)


def node_key_fault(key: str) -> str | None:
    """Return the reason why rcl refuses a node key of a parameter file, None if the key is valid.

    Each part before the last slash must be ``*``, ``**`` or a valid namespace, and the rest ``*``, ``**`` or a valid
    name of a node.
    """
    if key in ("/*", "/**"):
        return None
    namespace, slash, name = key.rpartition("/")
    if slash:
        absolute = f"{namespace}/" if namespace.startswith("/") or not namespace else f"/{namespace}/"
        tokens = absolute.split("/")[1:-1]
        if "" in tokens:
            return "it has // in it" if key.find("//") >= 0 else "it begins with //"
        for token in tokens:
            if token in ("*", "**") or _NAMESPACE_TOKEN.match(
                token
            ):  # the search for a fault is a hundred times slower
                continue
            fault = find_namespace_fault(f"/{token}")
            if fault is not None:
                return f"{fault.reason} in the namespace part {token!r:.100}"
    fault = None if name in ("*", "**") else find_node_name_fault(name)
    if fault is None:
        return None
    return f"{fault.reason} in the name {name!r:.100}" if name else "the name after the last slash is empty"


def _fail(name: str, event: yaml.Event, text: str) -> NoReturn:
    mark = event.start_mark
    assert mark is not None, "libyaml gives all events marks"
    raise ParameterFileError(f"{name}:{mark.line + 1}:{mark.column + 1}: {text}")


def _scalar(node: yaml.ScalarEvent) -> ParameterValue:
    if not node.value and node.style not in ("'", '"'):
        return plain_scalar("")
    if node.tag in _TYPE_TAGS and Distribution.selected().is_since("lyrical"):
        return _tagged_scalar(node.value, _TYPE_TAGS[node.tag])
    if node.tag == _STRING or node.style in ("'", '"'):
        return ParameterValue(ParameterType.STRING, node.value)
    return plain_scalar(node.value)


def _tagged_scalar(text: str, wanted: ParameterType) -> ParameterValue:
    value = plain_scalar(text)
    if value.type is ParameterType.INTEGER and wanted is ParameterType.DOUBLE:
        return ParameterValue(wanted, float(value.value))  # type: ignore[arg-type]  # an INTEGER is an int
    if value.type is not wanted:
        raise InvalidParameterValueError(f"the tag requires a value of type {wanted.name}, found {text!r:.100}")
    return value


def _bytes(node: yaml.ScalarEvent) -> ParameterValue | None:
    """Return the byte array of a base64 scalar with the tag ``!!binary``, which `dump_parameters` writes; else None."""
    if node.tag != _BINARY:
        return None
    try:
        return ParameterValue(ParameterType.BYTE_ARRAY, base64.b64decode("".join(node.value.split()), validate=True))
    except ValueError:
        return None


def dump_parameters(fully_qualified_name: str, values: Mapping[str, ParameterValue]) -> str:
    """Return the text of a parameter file for one node, with all parameters that have a value.

    Byte arrays are written as ``!!binary``, which only this package reads; rcl has no form for byte arrays. The type of
    an empty list is lost; the declaration of the parameter restores the type.
    """
    tree: dict[str, object] = {}
    for name, value in values.items():
        if value.is_set:
            *groups, key = _path(name, values)
            branch = tree
            for group in groups:
                branch = branch.setdefault(group, {})  # type: ignore[assignment]
            branch[key] = _value_text(value)
    lines = [f"{_key(fully_qualified_name, '')}", f"  {PARAMETERS_KEY}:", *_lines(tree, "    ")]
    if not tree:
        lines[-1] += " {}"
    return "\n".join(lines) + "\n"


def _path(name: str, values: Mapping[str, ParameterValue]) -> list[str]:
    """Split a parameter name at its dots into keys of nested maps.

    If a parameter has the name of a group, or a part of the name is empty, the rest of the name from there on is one
    key.
    """
    parts = name.split(".", _MAX_WRITTEN_LEVELS)
    prefix = ""
    for index, part in enumerate(parts[:-1]):
        prefix += part
        if prefix in values or not part or not parts[index + 1]:
            return [*parts[:index], ".".join(parts[index:])]
        prefix += "."
    return parts


def _lines(tree: dict[str, object], indent: str) -> Iterator[str]:
    for name, item in tree.items():
        key = _key(name, indent)
        if isinstance(item, dict):
            yield key
            yield from _lines(item, f"{indent}  ")
        else:
            yield f"{key} {item}"


def _key(name: str, indent: str) -> str:
    text = name if _PLAIN.match(name) or name.isdigit() else _quoted(name)
    return f"{indent}{text}:" if len(text) <= _MAX_SIMPLE_KEY else f"{indent}? {text}\n{indent}:"


def _value_text(value: ParameterValue) -> str:
    content = value.value
    if isinstance(content, bytes):
        return f'!!binary "{base64.b64encode(content).decode("ascii")}"'
    if isinstance(content, tuple):
        return f"[{', '.join(map(_scalar_text, content))}]"
    assert content is not None
    return _scalar_text(content)


def _scalar_text(value: bool | int | float | str) -> str:
    if isinstance(value, str):
        is_plain = _PLAIN.match(value) and plain_scalar(value).type is ParameterType.STRING
        return value if is_plain else _quoted(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        if not math.isfinite(value):
            return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
        if underflows(repr(value), value):
            return value.hex()  # as a decimal number it would be read as a string
    return repr(value)


def _quoted(text: str) -> str:
    """Return a string in double quotes for YAML, with escapes for all characters that are not printable."""
    quoted = json.dumps(text, ensure_ascii=False)
    if quoted.isprintable():
        return quoted
    hidden = "".join(char for char in set(quoted) if not char.isprintable())

    def escape(match: re.Match[str]) -> str:
        char = match.group()
        return f"\\u{ord(char):04x}" if char < "\U00010000" else f"\\U{ord(char):08x}"

    return re.sub(f"[{re.escape(hidden)}]", escape, quoted)
