"""Parameters, and their values as messages, as text and in files."""

from __future__ import annotations

import array
from enum import Enum
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple, Union  # noqa: F401, UP035

from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterType, ParameterValue

PARAMETER_SEPARATOR_STRING = "."

if TYPE_CHECKING:
    AllowableParameterValue = (
        bool
        | int
        | float
        | str
        | list[bytes]
        | tuple[bytes, ...]
        | list[bool]
        | tuple[bool, ...]
        | list[int]
        | tuple[int, ...]
        | array.array[int]
        | list[float]
        | tuple[float, ...]
        | array.array[float]
        | list[str]
        | tuple[str, ...]
        | None
    )
    """What a parameter can hold."""


class Parameter:
    """Name, type and value of a parameter.

    Without `type_` it is that of the value: TypeError when there is none. ValueError when the two do not agree.
    """

    class Type(Enum):
        """What a parameter holds; numbers of rcl_interfaces/ParameterType."""

        NOT_SET = 0
        BOOL = 1
        INTEGER = 2
        DOUBLE = 3
        STRING = 4
        BYTE_ARRAY = 5
        BOOL_ARRAY = 6
        INTEGER_ARRAY = 7
        DOUBLE_ARRAY = 8
        STRING_ARRAY = 9

        @classmethod
        def from_parameter_value(cls, parameter_value: object) -> Parameter.Type:
            """The type of a value; an empty list is a BYTE_ARRAY. TypeError for what no parameter holds."""
            if parameter_value is None:
                return cls.NOT_SET
            for type_, plain in _CLASSES.items():
                if isinstance(parameter_value, plain) and plain is not bytes:
                    return cls[type_]
            if not isinstance(parameter_value, (list, tuple, array.array)):
                raise TypeError(f"The given value is not one of the allowed types '{parameter_value}'.")
            for type_, plain in _CLASSES.items():
                if all(isinstance(item, plain) for item in parameter_value):
                    return cls[f"{type_}_ARRAY"]
            raise TypeError(f"The given value is not a list of one of the allowed types '{parameter_value}'.")

        def check(self, parameter_value: Any) -> bool:
            """Whether a value is of this type; a bool is an integer, too."""
            if self is Parameter.Type.NOT_SET:
                return parameter_value is None
            plain = _CLASSES[self.name.removesuffix("_ARRAY")]
            if not self.name.endswith("_ARRAY"):
                return isinstance(parameter_value, plain)
            sequences = (list, tuple, array.array) if plain in (int, float) else (list, tuple)
            if not isinstance(parameter_value, sequences):
                return False
            return all(
                isinstance(item, plain) and (not isinstance(item, bytes) or len(item) == 1) for item in parameter_value
            )

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> Parameter:
        """Of an rcl_interfaces/Parameter; ValueError for an unknown type."""
        type_ = Parameter.Type(param_msg.value.type)
        value = None if type_ is Parameter.Type.NOT_SET else getattr(param_msg.value, _FIELDS[type_.value])
        return cls(param_msg.name, type_, value)

    def __init__(self, name: str, type_: Type | None = None, value: Any = None) -> None:
        if type_ is None:
            type_ = Parameter.Type.from_parameter_value(value)
        if not isinstance(type_, Parameter.Type):
            raise TypeError(f"type must be an instance of '{Parameter.Type!r}'")
        if not type_.check(value):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self._type_ = type_
        self._name = name
        self._value = value

    @property
    def name(self) -> str:
        """Its name, with prefix."""
        return self._name

    @property
    def type_(self) -> Type:
        """What it holds."""
        return self._type_

    @property
    def value(self) -> Any:
        """None when it is not set."""
        return self._value

    def get_parameter_value(self) -> Any:
        """The value as rcl_interfaces/ParameterValue."""
        value = ParameterValue(type=self.type_.value)
        if self.type_ is not Parameter.Type.NOT_SET:
            setattr(value, _FIELDS[self.type_.value], self.value)
        return value

    def to_parameter_msg(self) -> Any:
        """As rcl_interfaces/Parameter."""
        return ParameterMsg(name=self.name, value=self.get_parameter_value())


_CLASSES: dict[str, type] = {"BYTE": bytes, "BOOL": bool, "INTEGER": int, "DOUBLE": float, "STRING": str}
"""Name of a type, without ``_ARRAY`` -> class of a value, or of all items; the first that fits counts."""

_FIELDS = {one.value: f"{one.name.lower()}_value" for one in Parameter.Type if one.value}
"""Number of a type -> field of rcl_interfaces/ParameterValue that holds it."""


def get_parameter_value(string_value: str) -> Any:
    """A text, as on a command line, as rcl_interfaces/ParameterValue of the type it looks like in YAML.

    What is no YAML, and what no parameter holds, is a text.
    """
    from rosidl_py_gen.base.yaml_text import YamlError, load_yaml  # takes a while, and most programs need none

    if not isinstance(string_value, str):
        raise AttributeError(f"get_parameter_value: expected a str, got {string_value!r:.100}")  # rclpy reads it
    try:
        found = load_yaml(string_value, like_rclpy=True)
    except YamlError:
        found = string_value
    if found == [] and isinstance(found, list):
        return ParameterValue(type=ParameterType.PARAMETER_BOOL_ARRAY)
    try:
        type_ = Parameter.Type.from_parameter_value(found)
    except TypeError:
        type_ = Parameter.Type.NOT_SET
    if type_ in (Parameter.Type.NOT_SET, Parameter.Type.BYTE_ARRAY):
        type_, found = Parameter.Type.STRING, string_value
    return Parameter("", type_, found).get_parameter_value()


def parameter_value_to_python(parameter_value: Any) -> Any:
    """What an rcl_interfaces/ParameterValue holds, arrays as lists; RuntimeError for an unknown type."""
    number = parameter_value.type
    if number == ParameterType.PARAMETER_NOT_SET:
        return None
    if number not in _FIELDS:
        raise RuntimeError(f"unexpected parameter type {number}")
    value = getattr(parameter_value, _FIELDS[number])
    return list(value) if number >= ParameterType.PARAMETER_BYTE_ARRAY else value


def parameter_dict_from_yaml_file(
    parameter_file: str, use_wildcard: bool = False, target_nodes: list[str] | None = None, namespace: str = ""
) -> dict[str, Any]:
    """The parameters of a file, as rcl_interfaces/Parameter by name.

    Args:
        parameter_file: its path.
        use_wildcard: take those of ``/**``, too; a node's own win.
        target_nodes: whose, as they are called in the file; by default all.
        namespace: put before each name.

    Raises:
        RuntimeError: the file is no file of parameters, or a node is not in it; it exceeds a limit of the loader.
    """
    from rosidl_py_gen.base.yaml_text import YamlError, load_yaml

    with open(parameter_file, encoding="utf-8") as file:
        text = file.read()
    try:
        nodes = load_yaml(text, like_rclpy=True)
    except YamlError as error:
        raise RuntimeError(error.at(parameter_file)) from None
    if not isinstance(nodes, dict):
        raise RuntimeError(f"{parameter_file} is not a valid ROS parameter file")
    for node in target_nodes or ():
        if node not in nodes:
            raise RuntimeError(f"Param file does not contain parameters for {node},only for nodes: {list(nodes)} ")
    chosen = ["/**"] if use_wildcard and "/**" in nodes else []
    chosen += target_nodes or [node for node in nodes if node != "/**"]
    if not chosen:
        raise RuntimeError("Param file does not contain selected parameters")
    found: dict[str, Any] = {}
    for node in chosen:
        if not isinstance(nodes[node], dict) or not isinstance(nodes[node].get("ros__parameters"), dict):
            raise RuntimeError(f"YAML file is not a valid ROS parameter file for node {node}")
        found.update(nodes[node]["ros__parameters"])
    return _flat(namespace, found)


def _flat(prefix: str, parameters: dict[Any, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in parameters.items():
        full = f"{prefix}{name}"
        if isinstance(value, dict):
            found.update(_flat(full + PARAMETER_SEPARATOR_STRING, value))
        else:
            found[full] = ParameterMsg(name=full, value=get_parameter_value(str(value)))
    return found
