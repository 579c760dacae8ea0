"""Mixin of `rclpy.node.Node` with the methods for its parameters."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, cast

from rcl_interfaces.msg import (
    ListParametersResult,
    ParameterDescriptor,
    ParameterEvent,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMsg

from rclpy._classes import checked_attribute
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from rclpy.parameter import PARAMETER_SEPARATOR_STRING, Parameter
from rclpy.qos import qos_profile_parameter_events
from rclpy.type_description_service import START_TYPE_DESCRIPTION_SERVICE_PARAM as _START_SERVICE
from rclpy.validate_parameter_name import validate_parameter_name
from rosidl_py_gen.runtime import _rclpy_support as rules

if TYPE_CHECKING:
    from rclpy.clock import Clock
    from rclpy.handles import Handle
    from rclpy.publisher import Publisher
    from rosidl_py_gen import runtime

    PreSetCallback = Callable[[list[Parameter]], list[Parameter]]
    OnSetCallback = Callable[[list[Parameter]], Any]
    PostSetCallback = Callable[[list[Parameter]], Any]

_NAME_ONLY = (
    "when declaring parameter named '{}', declaring a parameter only providing its name is deprecated; pass a default "
    "value, a Parameter.Type, or a descriptor with dynamic_typing=True"
)


class NodeParameters:
    """Parameters of a node and their callbacks, as in rclpy.

    The underlying node of rosidl_py_gen.runtime reads command lines and files, and declares only the values that it
    finds there.
    """

    PARAM_REL_TOL = rules.RELATIVE_TOLERANCE

    if TYPE_CHECKING:  # of Node
        _clock: Any

        @property
        def handle(self) -> Handle[runtime.Node]: ...
        def get_name(self) -> str: ...
        def get_namespace(self) -> str: ...
        def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any) -> Any: ...

    def _rosidl_init_parameters(
        self, program_overrides: Iterable[Parameter] | None, allow_undeclared: bool, declare: bool
    ) -> None:
        """Read the initial values of parameters, and declare these parameters if `declare` is True.

        Values in `program_overrides` take precedence.
        """
        self._rosidl_values: dict[str, Parameter] = {}
        self._rosidl_descriptors: dict[str, Any] = {}
        self._rosidl_pre_set: list[PreSetCallback] = []
        self._rosidl_on_set: list[OnSetCallback] = []
        self._rosidl_post_set: list[PostSetCallback] = []
        self._parameters, self._descriptors = self._rosidl_values, self._rosidl_descriptors
        self._pre_set_parameters_callbacks = self._rosidl_pre_set
        self._on_set_parameters_callbacks = self._rosidl_on_set
        self._post_set_parameters_callbacks = self._rosidl_post_set
        self._allow_undeclared_parameters = allow_undeclared
        events = self.create_publisher(ParameterEvent, "/parameter_events", qos_profile_parameter_events)
        self._rosidl_parameter_events, self._parameter_event_publisher = events, cast("Publisher | None", events)
        with self.handle as handle:
            initial_parameters = handle.entity.get_parameters_by_prefix("")
        if initial_parameters[_START_SERVICE].value.value is True:
            del initial_parameters[_START_SERVICE]  # the runtime declares it for its own service
        overrides = {
            name: Parameter(name, value=_to_rclpy_value(info.value.value)) for name, info in initial_parameters.items()
        }
        overrides |= {parameter.name: parameter for parameter in program_overrides or ()}
        self._parameter_overrides = overrides
        if declare:
            initial = [(name, override.value, ParameterDescriptor()) for name, override in overrides.items()]
            self.declare_parameters("", initial, ignore_override=True)

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        """Declare a parameter with a default value, or with a `Parameter.Type` and no value; return the parameter.

        Args:
            value: value that the parameter gets unless the program, the command line or a file has an initial value.
            descriptor: an rcl_interfaces/ParameterDescriptor.

        Raises:
            ParameterAlreadyDeclaredException: the parameter is declared.
            InvalidParameterException: the name is empty.
            InvalidParameterTypeException: the initial value is of another type.
            InvalidParameterValueException: a callback or the descriptor refuses the value.
            ValueError: neither a value nor a type is given, and the descriptor has no dynamic type.
        """
        only_name = value is None and descriptor is None
        declaration = (name,) if only_name else (name, value, descriptor or ParameterDescriptor())
        return self.declare_parameters("", [declaration], ignore_override)[0]

    def declare_parameters(
        self, namespace: str, parameters: Sequence[tuple[Any, ...]], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare several parameters, or none if one of the tuples is invalid; return the parameters.

        Args:
            namespace: prefix of each name, followed by a dot.
            parameters: tuples of name, value or type, and descriptor; the last two are optional.

        Raises:
            TypeError: a tuple is invalid. Others as `declare_parameter`.
        """
        requested: list[Parameter] = []
        descriptors: dict[str, Any] = {}
        overrides: dict[str, Parameter] = checked_attribute("_parameter_overrides", self._parameter_overrides, "keys")
        for index, declaration in enumerate(parameters):
            name, value, descriptor = _read_declaration(namespace, index, declaration)
            if not ignore_override and name in overrides:
                value = overrides[name].value
            requested.append(Parameter(name, value=value))
            descriptors[name] = descriptor
        if declared_names := [parameter.name for parameter in requested if parameter.name in self._rosidl_values]:
            raise ParameterAlreadyDeclaredException(declared_names)
        for parameter in requested:
            name, result = parameter.name, self._rosidl_apply([parameter], descriptors)
            if result.successful:
                continue
            error: Any = InvalidParameterValueException(name, parameter.value, result.reason)
            if result.reason.startswith("Wrong parameter type"):
                error = InvalidParameterTypeException(parameter, Parameter.Type(descriptors[name].type).name)
            error.is_of_initial_value = not ignore_override and name in overrides  # for `rosidl-py run`
            raise error
        return [self._rosidl_values[parameter.name] for parameter in requested]

    def undeclare_parameter(self, name: str) -> None:
        """Remove a parameter.

        Raises:
            ParameterNotDeclaredException: the parameter is not declared.
            ParameterImmutableException: the parameter is read-only.
        """
        if not self.has_parameter(name):
            raise ParameterNotDeclaredException(name)
        if self._rosidl_descriptors[name].read_only:
            raise ParameterImmutableException(name)
        del self._rosidl_values[name], self._rosidl_descriptors[name]

    def has_parameter(self, name: str) -> bool:
        return name in self._rosidl_values

    def get_parameter_types(self, names: list[str]) -> list[Any]:
        """Return the types of several parameters; raise TypeError if a name is not a str."""
        _require_str_names(names)
        return [self.get_parameter_type(name) for name in names]

    def get_parameter_type(self, name: str) -> Any:
        """Return the number of a parameter's type.

        An undeclared parameter has `Parameter.Type.NOT_SET` if the node allows undeclared parameters.

        Raises:
            ParameterNotDeclaredException: the parameter is not declared, and the node does not allow that.
        """
        if self.has_parameter(name):
            return self._rosidl_values[name].type_.value
        if self._allow_undeclared_parameters:
            return Parameter.Type.NOT_SET
        raise ParameterNotDeclaredException(name)

    def get_parameters(self, names: list[str]) -> list[Parameter]:
        """Return several parameters; raise TypeError if a name is not a str."""
        _require_str_names(names)
        return [self.get_parameter(name) for name in names]

    def get_parameter(self, name: str) -> Parameter:
        """Return a parameter; if the node allows undeclared parameters, an undeclared one is NOT_SET.

        Raises:
            ParameterNotDeclaredException: the parameter is not declared, and the node does not allow that.
            ParameterUninitializedException: the parameter has no value.
        """
        if self.has_parameter(name):
            parameter = self._rosidl_values[name]
            if parameter.type_ is Parameter.Type.NOT_SET and not self._rosidl_descriptors[name].dynamic_typing:
                raise ParameterUninitializedException(name)
            return parameter
        if self._allow_undeclared_parameters:
            return Parameter(name)
        raise ParameterNotDeclaredException(name)

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """Return a parameter, or if it has no value `alternative_value` (by default a parameter that is NOT_SET)."""
        parameter = self._rosidl_values.get(name)
        if parameter is not None and parameter.type_ is not Parameter.Type.NOT_SET:
            return parameter
        return Parameter(name) if alternative_value is None else alternative_value

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """Return all parameters below a prefix, as a dict from name without prefix to parameter.

        An empty prefix returns all.
        """
        start = prefix + PARAMETER_SEPARATOR_STRING if prefix else ""
        return {name[len(start) :]: value for name, value in self._rosidl_values.items() if name.startswith(start)}

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """Return the names of parameters and their groups as rcl_interfaces/ListParametersResult.

        Args:
            prefixes: names, or groups (beginnings of names up to a dot), that are listed; empty for all.
            depth: maximum number of name segments after the prefix; 0 for any number.

        Raises:
            TypeError: an argument has another type.
            ValueError: the depth is negative.
        """
        if not isinstance(prefixes, list):
            raise TypeError("The prefixes argument must be a list")
        if not all(isinstance(prefix, str) for prefix in prefixes):
            raise TypeError("All prefixes must be instances of type str")
        if not isinstance(depth, int):
            raise TypeError("The depth must be instance of type int")
        if depth < 0:
            raise ValueError("The depth must be greater than or equal to zero")
        result = rules.list_names(self._rosidl_values, prefixes, depth)
        return ListParametersResult(names=list(result.names), prefixes=list(filter(None, result.prefixes)))

    def describe_parameter(self, name: str) -> Any:
        """Return the rcl_interfaces/ParameterDescriptor of a parameter.

        An undeclared parameter has an empty descriptor if the node allows undeclared parameters.

        Raises:
            ParameterNotDeclaredException: the parameter is not declared, and the node does not allow that.
        """
        if name in self._rosidl_descriptors:
            return self._rosidl_descriptors[name]
        if self._allow_undeclared_parameters:
            return ParameterDescriptor()
        raise ParameterNotDeclaredException(name)

    def describe_parameters(self, names: list[str]) -> list[Any]:
        return [self.describe_parameter(name) for name in names]

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        """Set parameters one after the other; return an rcl_interfaces/SetParametersResult for each.

        Setting a parameter with dynamic type to NOT_SET undeclares it.

        Raises:
            ParameterNotDeclaredException: a parameter is not declared, and the node does not allow that.
            TypeError: an element is not a Parameter.
            Exception: raised by a callback.
        """
        return [self._rosidl_set([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set all parameters or none; return an rcl_interfaces/SetParametersResult.

        Setting a parameter with dynamic type to NOT_SET undeclares it.

        Raises:
            ParameterNotDeclaredException: a parameter is not declared, and the node does not allow that.
            TypeError: an element is not a Parameter.
            Exception: raised by a callback.
        """
        return self._rosidl_set(parameter_list)

    def _rosidl_set(self, parameter_list: list[Parameter]) -> Any:
        if self._rosidl_pre_set:
            callbacks = tuple(self._rosidl_pre_set)
            parameter_list = [parameter for callback in callbacks for parameter in callback(parameter_list)]
            if not parameter_list:
                return SetParametersResult(successful=False, reason=rules.EMPTY_LIST_REASON)
        if not all(isinstance(parameter, Parameter) for parameter in parameter_list):
            raise TypeError(f"parameter must be instance of type '{Parameter!r}'")
        undeclared_names = [parameter.name for parameter in parameter_list if parameter.name not in self._rosidl_values]
        if undeclared_names and not self._allow_undeclared_parameters:
            raise ParameterNotDeclaredException(undeclared_names)
        return self._rosidl_apply(parameter_list, None)

    def _rosidl_apply(self, parameters: list[Parameter], new_descriptors: dict[str, Any] | None) -> Any:
        """Check, set and publish parameters; return the result.

        Args:
            parameters: new values.
            new_descriptors: descriptors of parameters that are being declared; None to set declared parameters.
        """
        descriptors = self._rosidl_descriptors if new_descriptors is None else new_descriptors
        for parameter in parameters:
            if parameter.name in descriptors:
                reason = self._rosidl_refusal_reason(
                    parameter, descriptors[parameter.name], check_read_only=new_descriptors is None
                )
                if reason:
                    return SetParametersResult(successful=False, reason=reason)
        for callback in tuple(self._rosidl_on_set):
            result = callback(parameters)
            if not isinstance(result, SetParametersResult):
                text = "Callback returned an invalid type, it should return SetParameterResult."
                warnings.warn(text, stacklevel=3)
                result = SetParametersResult(successful=False, reason="Callback returned an invalid type")
            if not result.successful:
                return result
        namespace = self.get_namespace()
        stamp = checked_attribute("_clock", self._clock, "now").now().to_msg()
        event = ParameterEvent(stamp=stamp, node=f"{'' if namespace == '/' else namespace}/{self.get_name()}")
        for parameter in parameters:
            self._rosidl_store(parameter, new_descriptors, event)
        self._rosidl_parameter_events.publish(event)
        for post_callback in tuple(self._rosidl_post_set):
            post_callback(parameters)
        return SetParametersResult(successful=True)

    def _rosidl_refusal_reason(self, parameter: Parameter, descriptor: Any, *, check_read_only: bool) -> str:
        """Return the reason why a parameter's descriptor refuses a value; "" if it accepts the value.

        A descriptor with dynamic typing gets the type of the value.
        """
        name, value, type_ = parameter.name, parameter.value, parameter.type_
        descriptor.name = name
        if check_read_only and descriptor.read_only:
            return rules.read_only_reason(name)
        if descriptor.dynamic_typing:
            descriptor.type = type_.value
        elif type_ is Parameter.Type.NOT_SET:
            if self.has_parameter(name):
                return rules.UNDECLARED_REASON
        elif type_.value != descriptor.type:
            return rules.type_reason(Parameter.Type(descriptor.type).name, type_.name)
        if type_ is Parameter.Type.INTEGER and descriptor.integer_range:
            return rules.integer_range_reason(name, value, descriptor.integer_range[0])
        if type_ is Parameter.Type.DOUBLE and descriptor.floating_point_range:
            return rules.float_range_reason(name, value, descriptor.floating_point_range[0])
        return ""

    def _rosidl_store(self, parameter: Parameter, new_descriptors: dict[str, Any] | None, event: Any) -> None:
        name = parameter.name
        if new_descriptors is None and parameter.type_ is Parameter.Type.NOT_SET:
            event.deleted_parameters.append(parameter.to_parameter_msg())
            self._rosidl_values.pop(name, None)
            self._rosidl_descriptors.pop(name, None)
            return
        if new_descriptors is not None:
            self._rosidl_descriptors[name] = new_descriptors[name]
        elif name not in self._rosidl_descriptors:
            self._rosidl_descriptors[name] = ParameterDescriptor(dynamic_typing=True)
        is_new = self.get_parameter_or(name).type_ is Parameter.Type.NOT_SET
        (event.new_parameters if is_new else event.changed_parameters).append(parameter.to_parameter_msg())
        self._rosidl_values[name] = parameter

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """Replace the descriptor of a parameter, and return its value as rcl_interfaces/ParameterValue.

        Args:
            descriptor: an rcl_interfaces/ParameterDescriptor.
            alternative_value: rcl_interfaces/ParameterValue to set if the descriptor refuses the current value.

        Raises:
            ParameterNotDeclaredException: the parameter is not declared.
            ParameterImmutableException: the parameter is read-only.
            InvalidParameterValueException: the descriptor refuses both values.
        """
        if not self.has_parameter(name):
            return self.get_parameter(name).get_parameter_value()
        if self.describe_parameter(name).read_only:
            raise ParameterImmutableException(name)
        parameter = self.get_parameter(name)
        if self._rosidl_refusal_reason(parameter, descriptor, check_read_only=False):
            if alternative_value is not None:
                parameter = Parameter.from_parameter_msg(ParameterMsg(name=name, value=alternative_value))
            reason = self._rosidl_refusal_reason(parameter, descriptor, check_read_only=False)
            if reason:
                raise InvalidParameterValueException(name, parameter.value, reason)
        self._rosidl_values[name] = parameter
        self._rosidl_descriptors[name] = descriptor
        return self.get_parameter(name).get_parameter_value()

    def add_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """Register a function that takes the list of parameters before they are checked, and returns the list to set.

        The newest function is called first. The functions are not called for declarations.
        """
        self._rosidl_pre_set.insert(0, callback)

    def add_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        """Register a function that accepts or refuses a change by returning an rcl_interfaces/SetParametersResult.

        The newest function is called first.
        """
        if not callable(callback):
            raise TypeError(f"Callback must be callable, got {type(callback)}")
        self._rosidl_on_set.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        """Register a function that is called with parameters after they were set or declared; newest first."""
        if not callable(callback):
            raise TypeError(f"Callback must be callable, got {type(callback)}")
        self._rosidl_post_set.insert(0, callback)

    def remove_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """Remove a function of `add_pre_set_parameters_callback`; raise ValueError if it is not registered."""
        self._rosidl_pre_set.remove(callback)

    def remove_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        self._rosidl_on_set.remove(callback)

    def remove_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        self._rosidl_post_set.remove(callback)


def _require_str_names(names: list[str]) -> None:
    if not all(isinstance(name, str) for name in names):
        raise TypeError("All names must be instances of type str")


def _read_declaration(namespace: str, index: int, declaration: tuple[Any, ...]) -> tuple[str, Any, Any]:
    """Return name, value and descriptor of one of the tuples for `Node.declare_parameters`."""
    if not 1 <= len(declaration) <= 3:
        raise TypeError(
            f"Invalid parameter tuple length at index {index} in parameters list: {declaration}; "
            "expecting length between 1 and 3"
        )
    name, value, descriptor = (*declaration, None, None)[:3]
    if not isinstance(name, str):
        raise TypeError(f"First element {name} at index {index} in parameters list is not a str.")
    name = f"{namespace}.{name}" if namespace else name
    validate_parameter_name(name)
    descriptor = ParameterDescriptor() if len(declaration) < 3 else descriptor
    if not isinstance(descriptor, ParameterDescriptor):
        text = f"Third element {descriptor} at index {index} in parameters list is not a ParameterDescriptor."
        raise TypeError(text)
    if len(declaration) == 1:
        warnings.warn(_NAME_ONLY.format(name), stacklevel=5)
        descriptor.dynamic_typing = True
    if isinstance(value, Parameter.Type):
        if value is Parameter.Type.NOT_SET:
            raise ValueError(f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET")
        if descriptor.dynamic_typing:
            raise ValueError(
                f"When declaring parameter {{{name}}} passing a descriptor with"
                "`dynamic_typing=True` is not allowed when the parameter type is provided"
            )
        descriptor.type = value.value
        return name, None, descriptor
    if not descriptor.dynamic_typing:
        is_message = isinstance(value, ParameterValue)
        descriptor.type = value.type if is_message else Parameter.Type.from_parameter_value(value).value
        if descriptor.type == Parameter.Type.NOT_SET.value:
            text = "Cannot declare a statically typed parameter with default value of type PARAMETER_NOT_SET"
            raise ValueError(text)
    return name, value, descriptor


def _to_rclpy_value(value: Any) -> Any:
    """Return an initial parameter value in the form that rclpy uses: arrays as lists, bytes as a list of single bytes.

    An empty list in a parameter file is bytes in rosidl_py_gen.runtime, which gives it the declared type; in rclpy it
    is NOT_SET.
    """
    if value == b"":
        return None
    items = [bytes([byte]) for byte in value] if isinstance(value, bytes) else value
    return list(items) if isinstance(items, (tuple, list)) else items
