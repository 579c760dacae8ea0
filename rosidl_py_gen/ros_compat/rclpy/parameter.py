"""Parameters, and conversions of their values to and from messages, text and files."""

from __future__ import annotations

import array
from enum import Enum
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple, TypeVar, Union

from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterType, ParameterValue

from rclpy._classes import Subscriptable

PARAMETER_SEPARATOR_STRING = "."


AllowableParameterValue = Union[
    None, bool, int, float, str, list[bytes], list[bool], list[int], list[float], list[str], "array.array[Any]"
]
AllowableParameterValueT = TypeVar("AllowableParameterValueT")


class Parameter(Subscriptable):
    """Name, type and value of a parameter. By default the type is inferred from the value.

    Raises:
        TypeError: no type fits the value.
        ValueError: type and value do not agree.
    """

    class Type(Enum):
        """Type of a parameter, with the numbers of rcl_interfaces/ParameterType."""

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
            """Return the type of a value, BYTE_ARRAY for an empty list; raise TypeError if no type fits."""
            if parameter_value is None:
                return cls.NOT_SET
            for type_, python_class in _CLASSES.items():
                if isinstance(parameter_value, python_class) and python_class is not bytes:
                    return cls[type_]
            if not isinstance(parameter_value, (list, tuple, array.array)):
                raise TypeError(f"The given value is not one of the allowed types '{parameter_value}'.")
            for type_, python_class in _CLASSES.items():
                if all(isinstance(item, python_class) for item in parameter_value):
                    return cls[f"{type_}_ARRAY"]
            raise TypeError(f"The given value is not a list of one of the allowed types '{parameter_value}'.")

        def check(self, parameter_value: Any) -> bool:
            """Return True if a value is of this type; a bool is an INTEGER as well."""
            if self is Parameter.Type.NOT_SET:
                return parameter_value is None
            python_class = _CLASSES[self.name.removesuffix("_ARRAY")]
            if not self.name.endswith("_ARRAY"):
                return isinstance(parameter_value, python_class)
            sequences = (list, tuple, array.array) if python_class in (int, float) else (list, tuple)
            if not isinstance(parameter_value, sequences):
                return False
            return all(
                isinstance(item, python_class) and (not isinstance(item, bytes) or len(item) == 1)
                for item in parameter_value
            )

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> Parameter:
        """Convert an rcl_interfaces/Parameter; raise ValueError for an unknown type."""
        type_ = Parameter.Type(param_msg.value.type)
        value = None if type_ is Parameter.Type.NOT_SET else getattr(param_msg.value, _VALUE_FIELDS[type_.value])
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
        return self._name

    @property
    def type_(self) -> Type:
        return self._type_

    @property
    def value(self) -> Any:
        """Value of the parameter; None if it is not set."""
        return self._value

    def get_parameter_value(self) -> Any:
        """Return the value as rcl_interfaces/ParameterValue."""
        value = ParameterValue(type=self.type_.value)
        if self.type_ is not Parameter.Type.NOT_SET:
            setattr(value, _VALUE_FIELDS[self.type_.value], self.value)
        return value

    def to_parameter_msg(self) -> Any:
        """Return the parameter as rcl_interfaces/Parameter."""
        return ParameterMsg(name=self.name, value=self.get_parameter_value())


_CLASSES: dict[str, type] = {"BYTE": bytes, "BOOL": bool, "INTEGER": int, "DOUBLE": float, "STRING": str}
"""Python classes of parameter values by name of the type without ``_ARRAY``, also for all elements of an array. The
first match counts."""

_VALUE_FIELDS = {type_.value: f"{type_.name.lower()}_value" for type_ in Parameter.Type if type_.value}
"""Fields of rcl_interfaces/ParameterValue by the number of the type whose value they contain."""


def get_parameter_value(string_value: str) -> Any:
    """Convert the text of a value on a command line to an rcl_interfaces/ParameterValue of the type that YAML gives it.

    Invalid YAML, and values that no parameter can have, become strings.
    """
    from rosidl_py_gen.base.yaml_text import YamlError, YamlText  # slow to import, and rarely needed

    if not isinstance(string_value, str):
        raise AttributeError(f"get_parameter_value: expected a str, got {string_value!r:.100}")  # as in rclpy
    try:
        value = YamlText(string_value).load(like_rclpy=True)
    except YamlError:
        value = string_value
    if value == [] and isinstance(value, list):
        return ParameterValue(type=ParameterType.PARAMETER_BOOL_ARRAY)
    try:
        type_ = Parameter.Type.from_parameter_value(value)
    except TypeError:
        type_ = Parameter.Type.NOT_SET
    if type_ in (Parameter.Type.NOT_SET, Parameter.Type.BYTE_ARRAY):
        type_, value = Parameter.Type.STRING, string_value
    return Parameter("", type_, value).get_parameter_value()


def parameter_value_to_python(parameter_value: Any) -> Any:
    """Return the value in an rcl_interfaces/ParameterValue, arrays as lists; raise RuntimeError for an unknown type."""
    number = parameter_value.type
    if number == ParameterType.PARAMETER_NOT_SET:
        return None
    if number not in _VALUE_FIELDS:
        raise RuntimeError(f"unexpected parameter type {number}")
    value = getattr(parameter_value, _VALUE_FIELDS[number])
    return list(value) if number >= ParameterType.PARAMETER_BYTE_ARRAY else value


def parameter_dict_from_yaml_file(
    parameter_file: str, use_wildcard: bool = False, target_nodes: list[str] | None = None, namespace: str = ""
) -> dict[str, Any]:
    """Read a parameter file; return a dict from parameter name to rcl_interfaces/Parameter.

    Args:
        parameter_file: path of the file.
        use_wildcard: include the section ``/**``; sections of nodes take precedence.
        target_nodes: names of the nodes whose sections are read. [default: all]
        namespace: prefix of each name.

    Raises:
        RuntimeError: the file is not a parameter file, has no section for a node, or exceeds a limit of the loader.
    """
    from rosidl_py_gen.base.yaml_text import YamlError, YamlText

    with open(parameter_file, encoding="utf-8") as file:
        text = file.read()
    try:
        nodes = YamlText(text).load(like_rclpy=True)
    except YamlError as error:
        raise RuntimeError(error.at(parameter_file)) from None
    if not isinstance(nodes, dict):
        raise RuntimeError(f"{parameter_file} is not a valid ROS parameter file")
    for node in target_nodes or ():
        if node not in nodes:
            raise RuntimeError(f"Param file does not contain parameters for {node},only for nodes: {list(nodes)} ")
    sections = ["/**"] if use_wildcard and "/**" in nodes else []
    sections += target_nodes or [node for node in nodes if node != "/**"]
    if not sections:
        raise RuntimeError("Param file does not contain selected parameters")
    parameters: dict[str, Any] = {}
    for node in sections:
        if not isinstance(nodes[node], dict) or not isinstance(nodes[node].get("ros__parameters"), dict):
            raise RuntimeError(f"YAML file is not a valid ROS parameter file for node {node}")
        parameters.update(nodes[node]["ros__parameters"])
    return _to_messages(namespace, parameters)


def _to_messages(prefix: str, parameters: dict[Any, Any]) -> dict[str, Any]:
    messages: dict[str, Any] = {}
    for name, value in parameters.items():
        full = f"{prefix}{name}"
        if isinstance(value, dict):
            messages.update(_to_messages(full + PARAMETER_SEPARATOR_STRING, value))
        else:
            messages[full] = ParameterMsg(name=full, value=get_parameter_value(str(value)))
    return messages
