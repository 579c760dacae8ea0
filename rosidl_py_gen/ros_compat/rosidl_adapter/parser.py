"""Parser of .msg, .srv and .action files: types, fields and constants as objects.

Values are read as they are written in the file. The values in generated classes have also passed through IDL, which
changes some escapes (docs/internals/protocol.md 1.4).
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import TypedDict, TypeVar

from rosidl_py_gen.base.fieldtype import PRIMITIVES, FieldType
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend import LiteralProblem, file_scalar, is_interface_name, split_strings

PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR = "/"
COMMENT_DELIMITER = "#"
CONSTANT_SEPARATOR = "="
ARRAY_UPPER_BOUND_TOKEN = "<="
STRING_UPPER_BOUND_TOKEN = "<="

SERVICE_REQUEST_RESPONSE_SEPARATOR = "---"
SERVICE_REQUEST_MESSAGE_SUFFIX = "_Request"
SERVICE_RESPONSE_MESSAGE_SUFFIX = "_Response"
SERVICE_EVENT_MESSAGE_SUFFIX = "_Event"

ACTION_REQUEST_RESPONSE_SEPARATOR = "---"
ACTION_GOAL_SUFFIX = ACTION_GOAL_SERVICE_SUFFIX = "_Goal"
ACTION_RESULT_SUFFIX = ACTION_RESULT_SERVICE_SUFFIX = "_Result"
ACTION_FEEDBACK_SUFFIX = ACTION_FEEDBACK_MESSAGE_SUFFIX = "_Feedback"

PRIMITIVE_TYPES = [*FieldType.MSG_BASES, "duration", "time"]
"""Names of primitive types; `duration` and `time` are types of ROS 1, and have no values."""

# For programs that show them. Names are checked without them, because the last one backtracks exponentially.
VALID_PACKAGE_NAME_PATTERN = re.compile("^(?!.*__)(?!.*_$)[a-z][a-z0-9_]*$")
VALID_FIELD_NAME_PATTERN = VALID_PACKAGE_NAME_PATTERN
VALID_MESSAGE_NAME_PATTERN = re.compile("^[A-Z][A-Za-z0-9]*$")
VALID_CONSTANT_NAME_PATTERN = re.compile("^[A-Z]([A-Z0-9_]?[A-Z0-9]+)*$")

_Primitive = bool | int | float | str
_UNIT = re.compile(r"(\s*\[([^,\]]+)\])")


class Annotations(TypedDict, total=False):
    """Comments of a field, constant or message as a dict: the comment lines, and the unit that they contain in
    brackets.
    """

    comment: list[str]
    unit: str


class InvalidSpecification(Exception):
    """Raised for a definition that is wrong; base of the other errors of this module."""


class InvalidActionSpecification(InvalidSpecification):
    """Raised for an action without exactly two separators."""


class InvalidServiceSpecification(InvalidSpecification):
    """Raised for a service without exactly one separator."""


class InvalidResourceName(InvalidSpecification):
    """Raised for an invalid name of a package or message."""


class InvalidFieldDefinition(InvalidSpecification):
    """Raised for a line of a definition with a type, but without a name."""


class UnknownMessageType(InvalidSpecification):
    """Raised for a field whose message type is not known."""


class InvalidValue(Exception):
    """Raised for a value that a type cannot have."""

    def __init__(self, type_: Type | str, value_string: str, message_suffix: str | None = None) -> None:
        reason = "" if message_suffix is None else f": {message_suffix}"
        super().__init__(f"value '{value_string}' can not be converted to type '{type_}'{reason}")


# --- Names ------------------------------------------------------------------------------------------------------------


def is_valid_package_name(name: str) -> bool:
    """Return True if a text is a valid name of a package; raise `InvalidResourceName` for other objects than texts."""
    return RosName.PACKAGE_RULE.allows(_text(name))


def is_valid_field_name(name: str) -> bool:
    """Return True if a text is a valid name of a field; raise `InvalidResourceName` for other objects than texts."""
    return RosName.PACKAGE_RULE.allows(_text(name))


def is_valid_message_name(name: str) -> bool:
    """Return True if a text is a valid name of a message; raise `InvalidResourceName` for other objects than texts."""
    return is_interface_name(_text(name))


def is_valid_constant_name(name: str) -> bool:
    """Return True if a text is a valid name of a constant; raise `InvalidResourceName` for other objects than texts."""
    return RosName.CONSTANT_RULE.allows(_text(name))


def _text(name: object) -> str:
    if not isinstance(name, str):
        raise InvalidResourceName(name)
    return name


def _check_name(name: str, kind: str, is_valid: bool, pattern: re.Pattern[str], error: type[Exception]) -> None:
    if not is_valid:
        raise error(f"'{name}' is an invalid {kind} name. It should have the pattern '{pattern.pattern}'")


# --- Types ------------------------------------------------------------------------------------------------------------


class BaseType:
    """Type of a single value, or of the elements of an array.

    Attributes:
        pkg_name: package of a message type; None for a primitive type.
        type: name of the type.
        string_upper_bound: maximum length of a bounded string, or None.
    """

    __slots__ = ("pkg_name", "string_upper_bound", "type")

    def __init__(self, type_string: str, context_package_name: str | None = None) -> None:
        """Parse the text of a type.

        Args:
            type_string: text such as ``int32``, ``string<=5``, ``std_msgs/String`` or ``String``.
            context_package_name: package of a message name without a package.

        Raises:
            InvalidResourceName: the name of a package or message is invalid.
            TypeError: the bound of a string is invalid.
        """
        self.pkg_name: str | None = None
        self.type = type_string
        self.string_upper_bound: int | None = None
        if type_string in PRIMITIVE_TYPES:
            return
        name, bound_token, bound = type_string.partition(STRING_UPPER_BOUND_TOKEN)
        if bound_token and name in ("string", "wstring"):
            problem = f"the upper bound of the string type '{type_string}' must be a valid integer value > 0"
            self.type, self.string_upper_bound = name, _positive(bound, problem)
            return
        parts = type_string.split(PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR)
        if len(parts) == 1 and context_package_name is not None:
            parts.insert(0, context_package_name)
        if len(parts) != 2:
            raise InvalidResourceName(type_string)
        package, self.type = parts
        self.pkg_name = package
        is_package = is_valid_package_name(package)
        _check_name(package, "package", is_package, VALID_PACKAGE_NAME_PATTERN, InvalidResourceName)
        is_message = is_valid_message_name(self.type)
        _check_name(self.type, "message", is_message, VALID_MESSAGE_NAME_PATTERN, InvalidResourceName)

    def is_primitive_type(self) -> bool:
        """Return True for the type of a number, a boolean or a string."""
        return self.pkg_name is None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, BaseType) and (self.pkg_name, self.type, self.string_upper_bound) == (
            other.pkg_name,
            other.type,
            other.string_upper_bound,
        )

    def __hash__(self) -> int:
        return hash(str(self))

    def __str__(self) -> str:
        if self.pkg_name is not None:
            return f"{self.pkg_name}/{self.type}"
        return (
            f"{self.type}{STRING_UPPER_BOUND_TOKEN}{self.string_upper_bound}" if self.string_upper_bound else self.type
        )


class Type(BaseType):
    """Type of a field: a single value, an array or a sequence.

    Attributes:
        is_array: True for an array or a sequence.
        array_size: size of an array or maximum size of a sequence; None for an unbounded sequence.
        is_upper_bound: True for a bounded sequence.
    """

    __slots__ = ("array_size", "is_array", "is_upper_bound")

    def __init__(self, type_string: str, context_package_name: str | None = None) -> None:
        """Parse the text of a type, such as ``int32[<=5]``.

        Raises:
            InvalidResourceName: the name of a package or message is invalid.
            TypeError: the bound of a string, or the size of an array, is invalid.
        """
        self.is_array = type_string[-1] == "]"
        self.array_size: int | None = None
        self.is_upper_bound = False
        if self.is_array:
            base, bracket, size = type_string.rpartition("[")
            if not bracket:
                raise TypeError(f"the type {type_string} ends with ']' but does not contain a '['")
            size = size[:-1]
            self.is_upper_bound = size.startswith(ARRAY_UPPER_BOUND_TOKEN)
            if size:
                problem = (
                    f"the size of array type '{ARRAY_UPPER_BOUND_TOKEN}' must be a valid integer value > 0 optionally "
                    f"prefixed with '{type_string}' if it is only an upper bound"
                )
                self.array_size = _positive(size.removeprefix(ARRAY_UPPER_BOUND_TOKEN), problem)
            type_string = base
        super().__init__(type_string, context_package_name)

    def is_dynamic_array(self) -> bool:
        """Return True for the type of a sequence, bounded or unbounded."""
        return self.is_array and (self.array_size is None or self.is_upper_bound)

    def is_fixed_size_array(self) -> bool:
        """Return True for the type of an array of fixed size."""
        return self.is_array and not self.is_dynamic_array()

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Type)
            and super().__eq__(other)
            and (self.is_array, self.array_size, self.is_upper_bound)
            == (other.is_array, other.array_size, other.is_upper_bound)
        )

    __hash__ = BaseType.__hash__

    def __str__(self) -> str:
        if not self.is_array:
            return super().__str__()
        size = "" if self.array_size is None else self.array_size
        return f"{super().__str__()}[{ARRAY_UPPER_BOUND_TOKEN if self.is_upper_bound else ''}{size}]"


def _positive(text: str, problem: str) -> int:
    try:
        value = int(text)
    except ValueError:
        raise TypeError(problem) from None
    if value <= 0:
        raise TypeError(problem)
    return value


# --- Elements ---------------------------------------------------------------------------------------------------------


class Constant:
    """Constant in the definition of a message.

    Attributes:
        type: name of the primitive type.
        name, value: name and value of the constant.
        annotations: comment lines and unit.
    """

    __slots__ = ("annotations", "name", "type", "value")

    def __init__(self, primitive_type: str, name: str, value_string: str) -> None:
        """Create a constant, and parse the text of its value.

        Raises:
            TypeError: the type is not primitive.
            NameError: the name is not valid.
            ValueError: the value is None.
            InvalidValue: the type cannot have the value.
        """
        if primitive_type not in PRIMITIVE_TYPES:
            raise TypeError(f"the constant type '{primitive_type}' must be a primitive type")
        self.type = primitive_type
        _check_name(name, "constant", is_valid_constant_name(name), VALID_CONSTANT_NAME_PATTERN, NameError)
        self.name = name
        if value_string is None:
            raise ValueError("the constant value must not be 'None'")
        self.value = parse_primitive_value_string(Type(primitive_type), value_string)
        self.annotations: Annotations = {}

    def __eq__(self, other: object) -> bool:
        # NaN differs from itself, as in any comparison of values.
        if not isinstance(other, Constant):
            return False
        return self.type == other.type and self.name == other.name and self.value == other.value

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        value = f"'{self.value}'" if self.type in ("string", "wstring") else self.value
        return f"{self.type} {self.name}={value}"


class Field:
    """Field in the definition of a message.

    Attributes:
        type: `Type` of the field.
        name: name of the field.
        default_value: default value, a list for an array; None without a default.
        annotations: comment lines and unit.
    """

    def __init__(self, type_: Type, name: str, default_value_string: str | None = None) -> None:
        """Create a field, and parse the text of its default value.

        Raises:
            TypeError: `type_` is not a `Type`.
            NameError: the name is not valid.
            InvalidValue: the type cannot have the value.
            NotImplementedError: the type has no default values.
        """
        if not isinstance(type_, Type):
            raise TypeError(f"the field type '{type_}' must be a 'Type' instance")
        self.type = type_
        _check_name(name, "field", is_valid_field_name(name), VALID_FIELD_NAME_PATTERN, NameError)
        self.name = name
        self.default_value = None if default_value_string is None else parse_value_string(type_, default_value_string)
        self.annotations: Annotations = {}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Field):
            return False
        return self.type == other.type and self.name == other.name and self.default_value == other.default_value

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        if self.default_value is None:
            return f"{self.type} {self.name}"
        is_string = not self.type.is_array and self.type.type in ("string", "wstring") and self.type.pkg_name is None
        value = f"'{self.default_value}'" if is_string else self.default_value
        return f"{self.type} {self.name} {value}"


_Element = TypeVar("_Element", Field, Constant)


# --- Interfaces -------------------------------------------------------------------------------------------------------


class MessageSpecification:
    """Definition of a message, or of a section of a service or an action.

    Attributes:
        base_type: `BaseType` of the message.
        msg_name: name without the package.
        fields, constants: elements in the order of the file.
        annotations: comment lines at the beginning of the file, and their unit.
    """

    def __init__(self, pkg_name: str, msg_name: str, fields: Iterable[Field], constants: Iterable[Constant]) -> None:
        """Create the definition, and check its elements.

        Raises:
            InvalidResourceName: the name of the package or message is not valid.
            TypeError: an element has another class.
            ValueError: two elements have the same name.
        """
        self.base_type = BaseType(f"{pkg_name}{PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR}{msg_name}")
        self.msg_name = msg_name
        self.annotations: Annotations = {}
        self.fields = _checked(fields, Field, "field")
        self.constants = _checked(constants, Constant, "constant")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MessageSpecification) and (self.base_type, self.fields, self.constants) == (
            other.base_type,
            other.fields,
            other.constants,
        )

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        return "\n".join((f"# {self.base_type}", *map(str, self.constants), *map(str, self.fields)))


def _checked(elements: Iterable[_Element], kind: type[_Element], noun: str) -> list[_Element]:
    found: list[_Element] = []
    names: dict[str, int] = {}
    for index, element in enumerate(elements):
        if not isinstance(element, kind):
            raise TypeError(f"{noun} {index} must be a '{kind.__name__}' instance")
        found.append(element)
        names[element.name] = names.get(element.name, 0) + 1
    duplicates = sorted(name for name, count in names.items() if count > 1)
    if duplicates:
        raise ValueError(f"the {noun}s iterable contains duplicate names: {', '.join(duplicates)}")
    return found


class ServiceSpecification:
    """Definition of a service: a request and a response, both `MessageSpecification`."""

    def __init__(
        self, pkg_name: str, srv_name: str, request: MessageSpecification, response: MessageSpecification
    ) -> None:
        assert isinstance(request, MessageSpecification)
        assert isinstance(response, MessageSpecification)
        self.pkg_name, self.srv_name = pkg_name, srv_name
        self.request, self.response = request, response

    def __str__(self) -> str:
        separator = SERVICE_REQUEST_RESPONSE_SEPARATOR
        return f"# {self.pkg_name}/{self.srv_name}\n{self.request}\n{separator}\n{self.response}"


class ActionSpecification:
    """Definition of an action: goal, result and feedback, all `MessageSpecification`."""

    goal_service: ServiceSpecification
    result_service: ServiceSpecification

    def __init__(
        self,
        pkg_name: str,
        action_name: str,
        goal: MessageSpecification,
        result: MessageSpecification,
        feedback: MessageSpecification,
    ) -> None:
        for section in (goal, result, feedback):
            assert isinstance(section, MessageSpecification)
        self.pkg_name, self.action_name = pkg_name, action_name
        self.goal, self.result, self.feedback = goal, result, feedback


# --- Files ------------------------------------------------------------------------------------------------------------


def parse_message_file(pkg_name: str, interface_filename: str) -> MessageSpecification:
    """Return the definition in a .msg file; raise OSError, or the exceptions of `parse_message_string`."""
    path = Path(interface_filename)
    return parse_message_string(pkg_name, path.stem, path.read_text(encoding="utf-8"))


def parse_service_file(pkg_name: str, interface_filename: str) -> ServiceSpecification:
    """Return the definition in a .srv file; raise OSError, or the exceptions of `parse_service_string`."""
    path = Path(interface_filename)
    return parse_service_string(pkg_name, path.stem, path.read_text(encoding="utf-8"))


def parse_action_file(pkg_name: str, interface_filename: str) -> ActionSpecification:
    """Return the definition in an .action file; raise OSError, or the exceptions of `parse_action_string`."""
    path = Path(interface_filename)
    return parse_action_string(pkg_name, path.stem, path.read_text(encoding="utf-8"))


def parse_message_string(pkg_name: str, msg_name: str, message_string: str) -> MessageSpecification:
    """Return the definition of a message for the text of a .msg file.

    Raises:
        InvalidSpecification: a line has no name, or the name of a type is not valid.
        InvalidValue: a type cannot have a value.
        NameError, TypeError, ValueError: as `Field`, `Constant`, `Type` and `MessageSpecification`.
        IndexError: a line begins with a space.
    """
    fields: list[Field] = []
    constants: list[Constant] = []
    last: Field | Constant | None = None
    pending: list[str] = []  # comment lines of the next element
    message_comment, lines = extract_file_level_comments(message_string.replace("\t", " "))
    for line in map(str.rstrip, lines):
        text, mark, comment = line.partition(COMMENT_DELIMITER)
        comment = comment.lstrip(COMMENT_DELIMITER)
        if mark and text and not text.strip():  # an indented comment belongs to the element above
            if last is not None:
                last.annotations["comment"].append(comment)
            continue
        if mark:
            pending.append(comment)
        text = text.rstrip()
        if not text:
            continue
        last = _parse_element(pkg_name, msg_name, text)
        last.annotations["comment"] = pending
        pending = []
        if isinstance(last, Field):
            fields.append(last)
        else:
            constants.append(last)
    message = MessageSpecification(pkg_name, msg_name, fields, constants)
    message.annotations["comment"] = message_comment
    elements: list[Field | Constant] = [*fields, *constants]
    for instance in (message, *elements):
        process_comments(instance)
    return message


def _parse_element(pkg_name: str, msg_name: str, text: str) -> Field | Constant:
    type_string, _, rest = text.partition(" ")
    rest = rest.lstrip()
    if not rest:
        print("Error with:", pkg_name, msg_name, text, file=sys.stderr)
        raise InvalidFieldDefinition(text)
    if CONSTANT_SEPARATOR in rest:
        name, _, value = rest.partition(CONSTANT_SEPARATOR)
        return Constant(type_string, name.rstrip(), value.lstrip())
    name, _, value = rest.partition(" ")
    try:
        return Field(Type(type_string, context_package_name=pkg_name), name, value.lstrip() or None)
    except Exception as error:
        print(f"Error processing '{text}' of '{pkg_name}/{msg_name}': '{error}'", file=sys.stderr)
        raise


def parse_service_string(pkg_name: str, srv_name: str, message_string: str) -> ServiceSpecification:
    """Return the definition of a service for the text of a .srv file.

    Raises:
        InvalidServiceSpecification: the text does not contain exactly one separator.
        InvalidSpecification, InvalidValue, NameError, TypeError, ValueError, IndexError: as `parse_message_string`.
    """
    separator = SERVICE_REQUEST_RESPONSE_SEPARATOR
    sections = _sections(message_string, separator)
    if len(sections) != 2:
        which = "unique separator" if len(sections) > 2 else "separator"
        raise InvalidServiceSpecification(f"Could not find {which} '{separator}' between request and response")
    suffixes = (SERVICE_REQUEST_MESSAGE_SUFFIX, SERVICE_RESPONSE_MESSAGE_SUFFIX)
    messages = (
        parse_message_string(pkg_name, srv_name + suffix, text) for suffix, text in zip(suffixes, sections, strict=True)
    )
    return ServiceSpecification(pkg_name, srv_name, *messages)


def parse_action_string(pkg_name: str, action_name: str, action_string: str) -> ActionSpecification:
    """Return the definition of an action for the text of an .action file.

    Raises:
        InvalidActionSpecification: the text does not contain exactly two separators.
        InvalidSpecification, InvalidValue, NameError, TypeError, ValueError, IndexError: as `parse_message_string`.
    """
    separator = ACTION_REQUEST_RESPONSE_SEPARATOR
    sections = _sections(action_string, separator)
    if len(sections) != 3:
        raise InvalidActionSpecification(f"Number of '{separator}' separators nonconformant with action definition")
    suffixes = (ACTION_GOAL_SUFFIX, ACTION_RESULT_SUFFIX, ACTION_FEEDBACK_SUFFIX)
    messages = (
        parse_message_string(pkg_name, action_name + suffix, text)
        for suffix, text in zip(suffixes, sections, strict=True)
    )
    return ActionSpecification(pkg_name, action_name, *messages)


def _sections(text: str, separator: str) -> list[str]:
    sections: list[list[str]] = [[]]
    for line in text.splitlines():
        if line == separator:
            sections.append([])
        else:
            sections[-1].append(line)
    return ["\n".join(lines) for lines in sections]


# --- Comments ---------------------------------------------------------------------------------------------------------


def extract_file_level_comments(message_string: str) -> tuple[list[str], list[str]]:
    """Return the comment lines at the beginning of a definition, without ``#``, and the other lines."""
    lines = message_string.splitlines()
    count = next((at for at, line in enumerate(lines) if not line.startswith(COMMENT_DELIMITER)), len(lines))
    return [line.lstrip(COMMENT_DELIMITER) for line in lines[:count]], lines[count:]


def process_comments(instance: MessageSpecification | Field | Constant) -> None:
    """Move the unit from the comment of a field or constant to its annotations, and tidy the comment.

    The lines are dedented, and blank lines are dropped at both ends and after other blank lines.
    """
    if "comment" not in instance.annotations:
        return
    lines = instance.annotations["comment"]
    units = _UNIT.findall("\n".join(lines))
    if len(units) == 1:
        text, instance.annotations["unit"] = units[0]
        lines[:] = [line.replace(text, "") for line in lines]
    tidy: list[str] = []
    for line in lines:
        if line or (tidy and tidy[-1]):
            tidy.append(line)
    if tidy and not tidy[-1]:
        del tidy[-1]
    lines[:] = tidy
    if lines:
        instance.annotations["comment"] = textwrap.dedent("\n".join(lines)).split("\n")


# --- Values -----------------------------------------------------------------------------------------------------------


def parse_value_string(type_: Type, value_string: str) -> _Primitive | list[_Primitive]:
    """Return the value of a type that a text in a definition denotes.

    Raises:
        InvalidValue: the type cannot have the value.
        ValueError: a list of strings has wrong quotes or commas.
        IndexError: a list of strings ends with blanks.
        NotImplementedError: the type is a message.
    """
    if not type_.is_primitive_type():
        raise NotImplementedError(f"parsing string values into type '{type_}' is not supported")
    if not type_.is_array:
        return parse_primitive_value_string(type_, value_string)
    if not (value_string.startswith("[") and value_string.endswith("]")):
        raise InvalidValue(type_, value_string, "array value must start with '[' and end with ']'")
    inside = value_string[1:-1]
    if type_.type in ("string", "wstring"):
        texts = parse_string_array_value_string(inside, type_.array_size)
    else:
        texts = inside.split(",") if inside else []
    if type_.array_size:
        limit = "not more than" if type_.is_upper_bound else "exactly"
        is_right = len(texts) <= type_.array_size if type_.is_upper_bound else len(texts) == type_.array_size
        if not is_right:
            reason = f"array must have {limit} {type_.array_size} elements, not {len(texts)}"
            raise InvalidValue(type_, value_string, reason)
    element = Type(BaseType.__str__(type_))
    values = []
    for index, text in enumerate(texts):
        try:
            values.append(parse_primitive_value_string(element, text.strip()))
        except InvalidValue as error:
            raise InvalidValue(type_, value_string, f"element {index} with {error}") from None
    return values


def parse_string_array_value_string(element_string: str, expected_size: int | None) -> list[str]:
    """Return the strings in the text of a list without its brackets; `expected_size` has no effect.

    Raises:
        ValueError: quotes or commas are wrong.
        IndexError: the text ends with blanks.
    """
    try:
        return split_strings(element_string)
    except LiteralProblem as problem:
        if problem.is_at_end:
            raise IndexError(str(problem)) from None
        raise ValueError(str(problem)) from None


def parse_primitive_value_string(type_: Type, value_string: str) -> _Primitive:
    """Return the value of a primitive type that a text in a definition denotes.

    Raises:
        InvalidValue: the type cannot have the value.
        ValueError: the type is not primitive.
    """
    if not type_.is_primitive_type() or type_.is_array:
        raise ValueError("the passed type must be a non-array primitive type")
    name = type_.type
    is_string = name in ("string", "wstring")
    assert is_string or name in PRIMITIVES, f"unknown primitive type '{name}'"
    try:
        value = file_scalar(FieldType(name), value_string)
    except LiteralProblem:
        raise InvalidValue(name, value_string[1:-1] if is_string else value_string, _expected(name)) from None
    bound = type_.string_upper_bound
    if bound and isinstance(value, str) and len(value) > bound:
        reason = f"string must not exceed the maximum length of {bound} characters"
        raise InvalidValue(Type(BaseType.__str__(type_)), value, reason)
    return value


def _expected(name: str) -> str:
    if name in ("string", "wstring"):
        return "string inner quotes not properly escaped"
    if name == "bool":
        return "must be either 'true' / '1' or 'false' / '0'"
    if name.startswith("float"):
        return "must be a floating point number using '.' as the separator"
    low, high = PRIMITIVES[name].integer_range
    return f"must be a valid integer value >= {low} and <= {high}"


def validate_field_types(
    spec: MessageSpecification | ServiceSpecification | ActionSpecification, known_msg_types: list[BaseType]
) -> None:
    """Raise `UnknownMessageType` if a field of a definition has a message type that is not among the known types."""
    if isinstance(spec, MessageSpecification):
        kind, sections = "Message", [spec]
    elif isinstance(spec, ServiceSpecification):
        kind, sections = "Service", [spec.request, spec.response]
    else:
        assert isinstance(spec, ActionSpecification), f"Unknown specification type: {type(spec)}"
        kind, sections = "Action", [spec.goal, spec.result, spec.feedback]
    for item in (item for section in sections for item in section.fields):
        base = BaseType(BaseType.__str__(item.type))
        if not base.is_primitive_type() and base not in known_msg_types:
            raise UnknownMessageType(f"{kind} interface '{base}' contains an unknown field type: {item}")
