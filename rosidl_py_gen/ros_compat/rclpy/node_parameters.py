"""The parameter methods of `rclpy.node.Node`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, cast

from rcl_interfaces.msg import (
    ListParametersResult,
    ParameterDescriptor,
    ParameterEvent,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMsg

from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from rclpy.impl._fields import valid_or
from rclpy.impl.parameter_rules import initial_value, read_declaration, refusal
from rclpy.parameter import PARAMETER_SEPARATOR_STRING, Parameter
from rclpy.qos import qos_profile_parameter_events
from rclpy.type_description_service import START_TYPE_DESCRIPTION_SERVICE_PARAM
from rosidl_py_gen.runtime._rclpy_support import EMPTY_LIST_REASON, RELATIVE_TOLERANCE, list_names

if TYPE_CHECKING:
    from rclpy.clock import Clock
    from rclpy.handles import Handle
    from rclpy.publisher import Publisher
    from rosidl_py_gen import runtime

    PreSetCallback = Callable[[list[Parameter]], list[Parameter]]
    OnSetCallback = Callable[[list[Parameter]], Any]
    PostSetCallback = Callable[[list[Parameter]], Any]


class NodeParameters:
    """Declares, gets and sets; `Node` calls `_init_parameters` once it has a clock and can publish.

    The runtime's node reads command lines and files; it declares what they give, and that is all it knows.
    """

    PARAM_REL_TOL = RELATIVE_TOLERANCE

    if TYPE_CHECKING:  # of Node

        @property
        def handle(self) -> Handle[runtime.Node]: ...
        def get_name(self) -> str: ...
        def get_namespace(self) -> str: ...
        def _rosidl_own_clock(self) -> Clock: ...
        def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any) -> Publisher: ...

    def _rosidl_init_parameters(self, own: Iterable[Parameter] | None, allow_undeclared: bool, declare: bool) -> None:
        """Take initial values.

        Args:
            own: those that the program gives; they win over those of command line and files.
            allow_undeclared: what need not be declared can be set, and is NOT_SET when it is got.
            declare: declare all initial values.
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
        self._rosidl_allow_undeclared = self._allow_undeclared_parameters = allow_undeclared
        events = self.create_publisher(ParameterEvent, "/parameter_events", qos_profile_parameter_events)
        self._rosidl_parameter_events, self._parameter_event_publisher = events, cast("Publisher | None", events)
        with self.handle as handle:
            given = handle.entity.get_parameters_by_prefix("")
        if given[START_TYPE_DESCRIPTION_SERVICE_PARAM].value.value is True:
            del given[START_TYPE_DESCRIPTION_SERVICE_PARAM]  # the runtime declares it for its own
        found = {name: Parameter(name, value=initial_value(one.value.value)) for name, one in given.items()}
        self._rosidl_overrides = self._parameter_overrides = found | {one.name: one for one in own or ()}
        if declare:
            initial = [(name, one.value, ParameterDescriptor()) for name, one in self._rosidl_overrides.items()]
            self.declare_parameters("", initial, ignore_override=True)

    def _rosidl_allows_undeclared(self) -> bool:
        return valid_or(self._allow_undeclared_parameters, bool, self._rosidl_allow_undeclared)

    # --------------------------------------------------------------------------------------------------- declaring

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        """Declare a parameter with a default value, or a `Parameter.Type` and no value yet.

        Args:
            name: with prefix.
            value: what it holds unless an initial value is given, by the program, on the command line or in a file.
            descriptor: an rcl_interfaces/ParameterDescriptor.
            ignore_override: take no initial value.

        Raises:
            ParameterAlreadyDeclaredException: it is declared. InvalidParameterException: an empty name.
            InvalidParameterTypeException, InvalidParameterValueException: the initial value is of another type, or a
            callback or the descriptor refuse it. ValueError: neither value nor type, and no dynamic type.
        """
        given = (name,) if value is None and descriptor is None else (name, value, descriptor or ParameterDescriptor())
        return self.declare_parameters("", [given], ignore_override)[0]

    def declare_parameters(
        self, namespace: str, parameters: Sequence[tuple[Any, ...]], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare several: tuples of name, value or type, and descriptor, of which the last two may be left out.

        All are checked before one is declared; `namespace` and a dot come before each name. Raises TypeError for other
        tuples, and what `declare_parameter` raises.
        """
        wanted: list[Parameter] = []
        descriptors: dict[str, Any] = {}
        overrides: dict[str, Parameter] = valid_or(self._parameter_overrides, dict, self._rosidl_overrides)
        for index, given in enumerate(parameters):
            name, value, descriptor = read_declaration(namespace, index, given)
            if not ignore_override and name in overrides:
                value = overrides[name].value
            wanted.append(Parameter(name, value=value))
            descriptors[name] = descriptor
        if declared := [parameter.name for parameter in wanted if parameter.name in self._rosidl_values]:
            raise ParameterAlreadyDeclaredException(declared)
        for parameter in wanted:
            name, result = parameter.name, self._rosidl_apply([parameter], descriptors)
            if result.successful:
                continue
            error: Any = InvalidParameterValueException(name, parameter.value, result.reason)
            if result.reason.startswith("Wrong parameter type"):
                error = InvalidParameterTypeException(parameter, Parameter.Type(descriptors[name].type).name)
            error.is_of_initial_value = not ignore_override and name in overrides  # for `rosidl-py run`
            raise error
        return [self._rosidl_values[parameter.name] for parameter in wanted]

    def undeclare_parameter(self, name: str) -> None:
        """Forget it. ParameterNotDeclaredException, or ParameterImmutableException for a read-only one."""
        if not self.has_parameter(name):
            raise ParameterNotDeclaredException(name)
        if self._rosidl_descriptors[name].read_only:
            raise ParameterImmutableException(name)
        del self._rosidl_values[name], self._rosidl_descriptors[name]

    def has_parameter(self, name: str) -> bool:
        """Whether it is declared."""
        return name in self._rosidl_values

    # ----------------------------------------------------------------------------------------------------- getting

    def get_parameter_types(self, names: list[str]) -> list[Any]:
        """Of several, as `get_parameter_type`; TypeError for names that are no text."""
        _require_texts(names)
        return [self.get_parameter_type(name) for name in names]

    def get_parameter_type(self, name: str) -> Any:
        """The number of the type; `Parameter.Type.NOT_SET` itself for an undeclared one where that is allowed.

        Raises ParameterNotDeclaredException elsewhere.
        """
        if self.has_parameter(name):
            return self._rosidl_values[name].type_.value
        if self._rosidl_allows_undeclared():
            return Parameter.Type.NOT_SET
        raise ParameterNotDeclaredException(name)

    def get_parameters(self, names: list[str]) -> list[Parameter]:
        """Several, as `get_parameter`; TypeError for names that are no text."""
        _require_texts(names)
        return [self.get_parameter(name) for name in names]

    def get_parameter(self, name: str) -> Parameter:
        """A parameter by name; one that is NOT_SET for an undeclared one where that is allowed.

        Raises:
            ParameterNotDeclaredException: it is not declared. ParameterUninitializedException: it has no value yet.
        """
        if self.has_parameter(name):
            found = self._rosidl_values[name]
            if found.type_ is Parameter.Type.NOT_SET and not self._rosidl_descriptors[name].dynamic_typing:
                raise ParameterUninitializedException(name)
            return found
        if self._rosidl_allows_undeclared():
            return Parameter(name)
        raise ParameterNotDeclaredException(name)

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """A parameter, or the other one, by default one that is NOT_SET, when it is undeclared or has no value."""
        found = self._rosidl_values.get(name)
        if found is not None and found.type_ is not Parameter.Type.NOT_SET:
            return found
        return Parameter(name) if alternative_value is None else alternative_value

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """Those whose names begin with the prefix and a dot, by what follows; an empty prefix gives all."""
        start = prefix + PARAMETER_SEPARATOR_STRING if prefix else ""
        return {name[len(start) :]: found for name, found in self._rosidl_values.items() if name.startswith(start)}

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """Names, and the prefixes of these, as rcl_interfaces/ListParametersResult.

        Args:
            prefixes: names and beginnings of names, up to a dot; none means all.
            depth: how many parts a name may have after the prefix; 0 means any number.

        Raises:
            TypeError: something else. ValueError: a negative depth.
        """
        if not isinstance(prefixes, list):
            raise TypeError("The prefixes argument must be a list")
        if not all(isinstance(prefix, str) for prefix in prefixes):
            raise TypeError("All prefixes must be instances of type str")
        if not isinstance(depth, int):
            raise TypeError("The depth must be instance of type int")
        if depth < 0:
            raise ValueError("The depth must be greater than or equal to zero")

        found = list_names(self._rosidl_values, prefixes, depth)
        return ListParametersResult(names=list(found.names), prefixes=list(filter(None, found.prefixes)))

    def describe_parameter(self, name: str) -> Any:
        """Its rcl_interfaces/ParameterDescriptor; an empty one for an undeclared one where that is allowed.

        Raises ParameterNotDeclaredException elsewhere.
        """
        if name in self._rosidl_descriptors:
            return self._rosidl_descriptors[name]
        if self._rosidl_allows_undeclared():
            return ParameterDescriptor()
        raise ParameterNotDeclaredException(name)

    def describe_parameters(self, names: list[str]) -> list[Any]:
        """Of several, as `describe_parameter`."""
        return [self.describe_parameter(name) for name in names]

    # ----------------------------------------------------------------------------------------------------- setting

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        """Set one after the other; a refusal is told in its rcl_interfaces/SetParametersResult.

        NOT_SET undeclares, where the type is dynamic. Raises ParameterNotDeclaredException, TypeError for what is no
        Parameter, and what callbacks raise.
        """
        return [self._rosidl_set([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set all of them or none, as `set_parameters`."""
        return self._rosidl_set(parameter_list)

    def _rosidl_set(self, parameter_list: list[Parameter]) -> Any:
        if self._rosidl_pre_set:
            callbacks = tuple(self._rosidl_pre_set)
            parameter_list = [one for callback in callbacks for one in callback(parameter_list)]
            if not parameter_list:
                return SetParametersResult(successful=False, reason=EMPTY_LIST_REASON)
        if not all(isinstance(parameter, Parameter) for parameter in parameter_list):
            raise TypeError(f"parameter must be instance of type '{Parameter!r}'")
        undeclared = [parameter.name for parameter in parameter_list if parameter.name not in self._rosidl_values]
        if undeclared and not self._rosidl_allows_undeclared():
            raise ParameterNotDeclaredException(undeclared)
        return self._rosidl_apply(parameter_list, None)

    def _rosidl_apply(self, parameters: list[Parameter], declared: dict[str, Any] | None) -> Any:
        """Check, set and tell; with `declared`, the descriptors of parameters that are new."""
        descriptors = self._rosidl_descriptors if declared is None else declared
        for parameter in parameters:
            if parameter.name in descriptors:
                reason = self._rosidl_refusal(parameter, descriptors[parameter.name], check_read_only=declared is None)
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
        event = ParameterEvent(node=f"{'' if namespace == '/' else namespace}/{self.get_name()}")
        for parameter in parameters:
            self._rosidl_store(parameter, declared, event)
        event.stamp = self._rosidl_own_clock().now().to_msg()
        self._rosidl_parameter_events.publish(event)
        for told in tuple(self._rosidl_post_set):
            told(parameters)
        return SetParametersResult(successful=True)

    def _rosidl_refusal(self, parameter: Parameter, descriptor: Any, *, check_read_only: bool) -> str:
        descriptor.name = parameter.name
        is_declared = self.has_parameter(parameter.name)
        return refusal(parameter, descriptor, is_declared=is_declared, check_read_only=check_read_only)

    def _rosidl_store(self, parameter: Parameter, declared: dict[str, Any] | None, event: Any) -> None:
        name = parameter.name
        if declared is None and parameter.type_ is Parameter.Type.NOT_SET:
            event.deleted_parameters.append(parameter.to_parameter_msg())
            self._rosidl_values.pop(name, None)
            self._rosidl_descriptors.pop(name, None)
            return
        if declared is not None:
            self._rosidl_descriptors[name] = declared[name]
        elif name not in self._rosidl_descriptors:
            self._rosidl_descriptors[name] = ParameterDescriptor(dynamic_typing=True)
        is_new = self.get_parameter_or(name).type_ is Parameter.Type.NOT_SET
        (event.new_parameters if is_new else event.changed_parameters).append(parameter.to_parameter_msg())
        self._rosidl_values[name] = parameter

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """Give it another descriptor; returns the rcl_interfaces/ParameterValue that it has then.

        Args:
            name: of the parameter.
            descriptor: an rcl_interfaces/ParameterDescriptor.
            alternative_value: an rcl_interfaces/ParameterValue for it where the descriptor refuses what it has.

        Raises:
            ParameterNotDeclaredException: it is not declared. ParameterImmutableException: it is read-only.
            InvalidParameterValueException: the descriptor refuses both values.
        """
        if not self.has_parameter(name):
            return self.get_parameter(name).get_parameter_value()
        if self.describe_parameter(name).read_only:
            raise ParameterImmutableException(name)
        parameter = self.get_parameter(name)
        if self._rosidl_refusal(parameter, descriptor, check_read_only=False):
            if alternative_value is not None:
                parameter = Parameter.from_parameter_msg(ParameterMsg(name=name, value=alternative_value))
            reason = self._rosidl_refusal(parameter, descriptor, check_read_only=False)
            if reason:
                raise InvalidParameterValueException(name, parameter.value, reason)
        self._rosidl_values[name] = parameter
        self._rosidl_descriptors[name] = descriptor
        return self.get_parameter(name).get_parameter_value()

    # --------------------------------------------------------------------------------------------------- callbacks

    def add_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """Have a function change lists of parameters before they are checked; newest first.

        It is given the list and returns what is to be set, all at once; not asked when parameters are declared.
        """
        self._rosidl_pre_set.insert(0, callback)

    def add_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        """Have a function decide, by rcl_interfaces/SetParametersResult, before parameters change; newest first."""
        if not callable(callback):
            raise TypeError(f"Callback must be callable, got {type(callback)}")
        self._rosidl_on_set.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        """Have a function told of parameters that changed, also of declared ones; newest first."""
        if not callable(callback):
            raise TypeError(f"Callback must be callable, got {type(callback)}")
        self._rosidl_post_set.insert(0, callback)

    def remove_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """Ask it no more; ValueError when it is not there."""
        self._rosidl_pre_set.remove(callback)

    def remove_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        """Ask it no more; ValueError when it is not there."""
        self._rosidl_on_set.remove(callback)

    def remove_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        """Tell it no more; ValueError when it is not there."""
        self._rosidl_post_set.remove(callback)


def _require_texts(names: list[str]) -> None:
    if not all(isinstance(name, str) for name in names):
        raise TypeError("All names must be instances of type str")
