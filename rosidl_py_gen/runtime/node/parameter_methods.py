"""Parameter methods of a node, and the start of its standard services.

Standard services are the services for parameters, time, logger levels and type descriptions. Order of the start, as in
docs/internals/protocol.md 9.1: parameter events, `use_sim_time`, the six parameter services, logger levels, type
description. Modules that not every node needs are imported when they are first used.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, get_args, get_origin, overload

from rosidl_py_gen.base.callbacks import Registration, RegistrationSet
from rosidl_py_gen.runtime.loop.queues import AsyncQueue
from rosidl_py_gen.runtime.node.context import NodeBase, core_of
from rosidl_py_gen.runtime.node.timers import TimeSource
from rosidl_py_gen.runtime.parameters.initial_values import overrides_for
from rosidl_py_gen.runtime.parameters.store import ParameterStore, require_plain
from rosidl_py_gen.runtime.parameters.values import (
    ARRAY_OF,
    SEPARATOR,
    TYPE_OF,
    InvalidParameterValueError,
    ListParametersResult,
    Parameter,
    ParameterDescriptor,
    ParameterEvent,
    ParameterType,
    PythonValue,
    SetResult,
    WrongParameterTypeError,
    as_names,
    as_parameters,
    parameter_value,
    require_name,
    require_names,
)
from rosidl_py_gen.runtime.type_descriptions import start_type_descriptions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rosidl_py_gen.runtime.parameters.client import ParameterClient, ParameterEvents
    from rosidl_py_gen.runtime.parameters.initial_values import ParameterOverrides
    from rosidl_py_gen.runtime.parameters.services import ParameterEventPublisher, ParameterService, ParameterServices
    from rosidl_py_gen.runtime.parameters.values import ParametersToSet

T = TypeVar("T")
# bool before int, and int before float: type checkers accept the former where the latter is expected.
ScalarT = TypeVar("ScalarT", bool, int, float, str, bytes)
ItemT = TypeVar("ItemT", bool, int, float, str)


class ParameterChange(NamedTuple):
    """Change of a parameter; `value` is None if the parameter was unset or undeclared."""

    name: str
    value: PythonValue


class ParameterMethods(NodeBase):
    """Parameter methods of `Node`, whose constructor must call `_open_parameters`."""

    _store: ParameterStore
    _changes: list[AsyncQueue[ParameterChange]]
    _event_callbacks: RegistrationSet[Callable[[ParameterEvent], object]]

    def _open_parameters(
        self,
        own_arguments: Sequence[ParameterOverrides],
        parameter_overrides: Mapping[str, object],
        *,
        use_global_arguments: bool,
        allow_undeclared: bool,
        declares_overrides: bool,
        start_services: bool,
        parameter_events: bool,
        logger_services: bool,
        time_source: bool,
    ) -> None:
        """Create the parameter store and start the standard services in the order of rclpy; arguments as for `Node`."""
        own_overrides = {item.name: item.value for item in as_parameters(parameter_overrides)}
        core = core_of(self.context)
        arguments = [*(core.ros_arguments.parameters if use_global_arguments else ()), *own_arguments]
        self._changes = changes = list[AsyncQueue[ParameterChange]]()
        self._event_callbacks = callbacks = RegistrationSet[Callable[[ParameterEvent], object]]()
        events: ParameterEventPublisher | None = None
        if parameter_events:
            from rosidl_py_gen.runtime.parameters.services import ParameterEventPublisher

            events = ParameterEventPublisher(self._scope, self._names, self.clock)

        def on_event(event: ParameterEvent) -> None:
            for stream in tuple(changes):
                if stream.closed:
                    changes.remove(stream)
                    self._scope.unregister(stream)
                for parameter in (*event.new, *event.changed, *event.deleted):
                    stream._push(ParameterChange(parameter.name, parameter.value.value))
            if events is not None:
                events.publish_event(event)
            for callback in callbacks if event else ():
                try:
                    callback(event)
                except Exception:
                    self._scope.report_failure("the callback of a parameter event")

        own_name = self._names.fully_qualified_name
        self._store = ParameterStore(
            overrides_for(arguments, own_name) | own_overrides,
            sources={
                name: entry.source
                for entry in arguments
                if entry.matches(own_name)
                for name in entry.values
                if name not in own_overrides
            },
            allow_undeclared=allow_undeclared,
            on_event=on_event,
            on_failure=self._scope.report_failure,
        )
        if time_source:
            TimeSource(self._scope, self._names, self._store, self.clock)
        if declares_overrides:
            self._store.declare_overrides()
        if start_services:
            self._parameter_services().serve(self._names)
        if logger_services:
            from rosidl_py_gen.runtime.parameters.services import start_logger_services

            start_logger_services(self._scope, self._names)
        start_type_descriptions(self._scope, self._names, self._store)
        core.initial_values.register_node(
            self._scope,
            self._store,
            own_overrides,
            own_arguments,
            self._may_declare_more,
            takes_global=use_global_arguments,
        )

    def _may_declare_more(self) -> bool:
        """Return True while the node may still declare parameters, so that unused initial values cause no
        warning yet.
        """
        return False

    def declare_parameters(
        self,
        cls: type[T],
        *,
        prefix: str = "",
        initial: T | None = None,
        validator: Callable[[T], str | None] | None = None,
    ) -> T:
        """Declare the fields of a dataclass as parameters; return an object whose attributes are their current values.

        Args:
            cls: dataclass, whose annotations are the types and constraints of the parameters.
            prefix: prepended to all names.
            initial: object with the default values; None uses the defaults of the fields.
            validator: gets an object with the new values, and returns a reason to refuse them, or None.

        Raises:
            ParameterClassError: an annotation cannot be a parameter, or a field has no default.
            ParameterError: a name is taken, or an override is invalid. No parameter is declared.
            TypeError: an argument has the wrong type, or the validator is async.
        """
        from rosidl_py_gen.runtime.parameters.dataclass_parameters import bind_class

        self._scope.require_open(False, "the node")
        return bind_class(self._store, cls, prefix=prefix, initial=initial, validator=validator)

    @overload
    def declare_parameter(
        self, name: str, default: ScalarT, descriptor: ParameterDescriptor | None = None, *,
        ignore_override: bool = False,
    ) -> ScalarT: ...  # fmt: skip
    @overload
    def declare_parameter(
        self, name: str, default: list[ItemT] | tuple[ItemT, ...], descriptor: ParameterDescriptor | None = None, *,
        ignore_override: bool = False,
    ) -> tuple[ItemT, ...]: ...  # fmt: skip
    @overload
    def declare_parameter(
        self, name: str, default: object = None, descriptor: ParameterDescriptor | None = None, *,
        ignore_override: bool = False,
    ) -> PythonValue: ...  # fmt: skip
    def declare_parameter(
        self,
        name: str,
        default: object = None,
        descriptor: ParameterDescriptor | None = None,
        *,
        ignore_override: bool = False,
    ) -> Any:
        """Declare a parameter and return its value: the override if there is one, else the default.

        The value has the type of `default`; a list is returned as a tuple. An override may have another type only if
        the descriptor sets `dynamic_typing`.

        Raises:
            ParameterAlreadyDeclaredError: the name is taken.
            InvalidParameterNameError: the name is invalid.
            InvalidParameterValueError: a range or a callback refuses the value, or the type is missing.
            WrongParameterTypeError: default or override have another type.
            TypeError: the descriptor, or one of its fields, has the wrong type.
        """
        self._scope.require_open(False, "the node")
        value = parameter_value(default)
        return self._store.declare(name, value, descriptor, ignore_override=ignore_override).value

    def set_descriptor(self, name: str, descriptor: ParameterDescriptor, alternative: object = None) -> PythonValue:
        """Replace the descriptor of a parameter, and return its value; in case of an error nothing is changed.

        The name in the descriptor is ignored; without a type the parameter keeps its type. For an undeclared parameter
        the call has no effect, if those are allowed.

        Args:
            name: name of the parameter.
            descriptor: new descriptor.
            alternative: new value if the current one does not fit; None: the current value must fit.

        Raises:
            ParameterNotDeclaredError: the parameter is not declared.
            ParameterImmutableError: the parameter is read-only.
            InvalidParameterValueError: neither value fits, a callback refuses the alternative, or a range is invalid.
            TypeError: the descriptor, or one of its fields, has the wrong type.
        """
        self._scope.require_open(False, "the node")
        value = parameter_value(alternative)
        return self._store.set_descriptor(require_name(name), descriptor, value).value

    def undeclare_parameter(self, name: str) -> None:
        """Remove a parameter; the field of a dataclass keeps the last value.

        Raises:
            ParameterNotDeclaredError: the parameter is not declared.
            ParameterImmutableError: the parameter is read-only.
        """
        self._scope.require_open(False, "the node")
        self._store.undeclare(require_name(name))

    def has_parameter(self, name: str) -> bool:
        """Return True if a parameter is declared, with or without a value."""
        return self._store.has(require_name(name))

    @overload
    def get_parameter(self, name: str) -> PythonValue: ...
    @overload
    def get_parameter(self, name: str, type: type[T], default: T) -> T: ...
    @overload
    def get_parameter(self, name: str, type: type[T], default: None = None) -> T | None: ...
    def get_parameter(self, name: str, type: Any = None, default: Any = None) -> Any:
        """Return the value of a parameter, or `default` if it is declared without value.

        Args:
            name: name of the parameter.
            type: ``bool``, ``int``, ``float``, ``str``, ``bytes``, or a list of one of the first four. None: any.
            default: result for a parameter without value.

        Raises:
            ParameterNotDeclaredError: the parameter is not declared.
            WrongParameterTypeError: the value has another type.
        """
        value = self._store.get_or_unset(require_name(name))
        kind = None if type is None else _expected_type(type)
        if not value.is_set:
            return default
        if kind is None:
            return value.value
        if kind is not value.type:
            raise WrongParameterTypeError(name, kind.name, value.type.name)
        return list(value.value) if get_origin(type) is list else value.value  # type: ignore[arg-type]

    def get_parameters(self, names: Sequence[str]) -> list[PythonValue]:
        """Return the values of parameters, read at one moment, in order.

        Raises:
            ParameterNotDeclaredError: a parameter is not declared.
            ParameterUninitializedError: a parameter has no value.
            TypeError: `names` is a single text.
        """
        return [value.value for value in self._store.get_values(require_names(names))]

    def describe_parameter(self, name: str) -> ParameterDescriptor:
        """Return the descriptor of a parameter; raise `ParameterNotDeclaredError` if the parameter is not declared."""
        return self._store.describe(require_name(name))

    def get_parameters_by_prefix(self, prefix: str = "") -> dict[str, Parameter]:
        """Return all parameters below a prefix as a dict from name without prefix to `Parameter`.

        The empty prefix returns all parameters. The parameters are read at one moment, and may have no value. For
        ``arm`` and ``arm.speed``, the prefix ``arm`` returns only ``speed``.
        """
        start = f"{require_name(prefix, 'a prefix')}{SEPARATOR}" if prefix else ""
        values = self._store.values().items()
        return {name[len(start) :]: Parameter(name, value) for name, value in values if name.startswith(start)}

    def list_parameters(self, prefixes: str | Sequence[str] = (), depth: int = 0) -> ListParametersResult:
        """Return the names and groups of all parameters or of the parameters below `prefixes`; depth 0 has no limit."""
        return self._store.listing(as_names(prefixes, "prefixes"), depth)

    def set_parameter(self, name: str, value: object) -> None:
        """Set a parameter, from any thread.

        Raises:
            ParameterNotDeclaredError: the parameter is not declared.
            InvalidParameterValueError: the value is refused; the text contains the reason.
            CallbackAnswerError: a callback returned an invalid result.
            TypeError: the name is not a string.
            ClosedError: the node is closed.
            Exception: raised by a callback that was added with `raises`.
        """
        result = self.set_parameters_atomically({name: value}, require_declared=True)
        if not result.successful:
            raise InvalidParameterValueError(result.reason)

    def set_parameters(self, values: ParametersToSet, *, require_declared: bool = False) -> list[SetResult]:
        """Set parameters one after the other, from any thread; return a result for each parameter.

        Args:
            values: dict from name to value, or `Parameter` objects.
            require_declared: raise for an undeclared name, unless the node allows undeclared parameters; earlier
                parameters remain set. Otherwise the result for that name is a refusal.

        Raises:
            InvalidParameterValueError: a parameter cannot have such a value; no parameter is set.
            ParameterNotDeclaredError: `require_declared`, and a parameter is not declared.
            CallbackAnswerError: a callback returned an invalid result.
            TypeError: a name is not a string.
            ClosedError: the node is closed.
            Exception: raised by a callback that was added with `raises`.
        """
        return self._store.set_individually(self._coerce_empty_lists(values), require_declared=require_declared)

    def set_parameters_atomically(self, values: ParametersToSet, *, require_declared: bool = False) -> SetResult:
        """Set all parameters or none, with one event; parameters and exceptions as for `set_parameters`."""
        return self._store.set_atomically(self._coerce_empty_lists(values), require_declared=require_declared)

    def _coerce_empty_lists(self, values: ParametersToSet) -> list[Parameter]:
        """Return the parameters to set, in which an empty list gets the declared type, because it has no element type
        of its own.

        Raises:
            ClosedError: the node is closed.
        """
        self._scope.require_open(False, "the node")
        coerced = []
        for parameter in as_parameters(values):
            value = parameter.value
            if value.value == b"" and self._store.has(parameter.name):
                kind = self._store.describe(parameter.name).type
                value = parameter_value((), kind) if kind.is_array else value
            coerced.append(Parameter(parameter.name, value))
        return coerced

    def add_pre_set_callback(
        self, callback: Callable[[list[Parameter]], list[Parameter]], *, raises: bool = False
    ) -> Registration:
        """Add a callback that may replace the list of parameters to set, until the returned registration is closed.

        The callback is called on the thread that sets parameters, and sets by other threads wait for it: it must not
        wait for the event loop.

        Args:
            callback: plain function that gets the parameters and returns the parameters to set instead.
            raises: raise exceptions of the callback from the method that sets or declares, as in rclpy; a set by
                another node is refused. Otherwise an exception is logged, and the set is refused.

        Raises:
            TypeError: the callback is async.
        """
        return self._store.callbacks.add("pre-set", callback, raises=raises)

    def add_on_set_callback(
        self, callback: Callable[[list[Parameter]], SetResult], *, raises: bool = False
    ) -> Registration:
        """Add a callback that may refuse to set parameters; the newest callback is called first.

        The callback is called on the thread that sets parameters, and sets by other threads wait for it: it must not
        wait for the event loop. Closing the returned registration removes the callback.

        Args:
            callback: plain function that gets the parameters and returns a `SetResult`.
            raises: raise exceptions of the callback from the method that sets or declares, as in rclpy; a set by
                another node is refused. Otherwise an exception is logged, and the set is refused.

        Raises:
            TypeError: the callback is async.
        """
        return self._store.callbacks.add("on-set", callback, raises=raises)

    def add_post_set_callback(
        self, callback: Callable[[list[Parameter]], None], *, raises: bool = False
    ) -> Registration:
        """Add a callback that is called, on the thread that sets parameters, after each successful set and declaration.

        Args:
            callback: plain function that gets the parameters.
            raises: raise exceptions of the callback from the method that sets, after all callbacks; the values remain
                set. Otherwise an exception is logged.

        Raises:
            TypeError: the callback is async.
        """
        return self._store.callbacks.add("post-set", callback, raises=raises)

    def parameter_changes(self) -> AsyncQueue[ParameterChange]:
        """Return a queue of all changes of this node's parameters from now on, made in any thread."""
        stream: AsyncQueue[ParameterChange] = AsyncQueue()
        self._changes.append(stream)
        self._scope.register(stream)
        return stream

    def add_parameter_event_callback(self, callback: Callable[[ParameterEvent], object]) -> Registration:
        """Add a callback that gets each event about parameters of this node, as published on ``/parameter_events``.

        The callback is also called if the node does not publish the events. It is called on the thread that sets
        parameters, in the order of the sets, and sets by other threads wait for it. Its exceptions are logged.

        Raises:
            TypeError: the callback is async.
        """
        require_plain(callback, "the callback of parameter events", "the event")
        return self._event_callbacks.add(callback)

    def parameter_services(self) -> list[ParameterService]:
        """Return the six parameter services of this node as functions, for a program that serves them itself.

        With ``start_services=False`` the node does not serve them.
        """
        self._scope.require_open(False, "the node")
        return self._parameter_services().handlers()

    def _parameter_services(self) -> ParameterServices:
        from rosidl_py_gen.runtime.parameters.services import ParameterServices

        return ParameterServices(self._scope, self._store, core_of(self.context).initial_values.on_listed)

    def parameter_events(self, node: str | None = None) -> ParameterEvents:
        """Return an async iterator of the events that a node, or with None every node, publishes on
        ``/parameter_events`` from now on.
        """
        from rosidl_py_gen.runtime.parameters.client import ParameterEvents

        full_name = None if node is None else self._names.resolve_topic(require_name(node, "the name of a node"))
        return ParameterEvents(self._scope, self._names, full_name)

    def create_parameter_client(self, node: str) -> ParameterClient:
        """Create a client for the parameters of another node, whose name is resolved like a topic name."""
        from rosidl_py_gen.runtime.parameters.client import ParameterClient

        self._scope.require_open(False, "the node")
        return ParameterClient(self._scope, self._names, require_name(node, "the name of a node"))


def _expected_type(type_: Any) -> ParameterType:
    kind = TYPE_OF.get(type_) if isinstance(type_, type) else None
    if get_origin(type_) in (list, tuple) and get_args(type_):
        kind = ARRAY_OF.get(TYPE_OF.get(get_args(type_)[0]))
    if kind is not None:
        return kind
    raise TypeError(
        f"{type_!r} is not a parameter type; expected bool, int, float, str, bytes or a list such as list[int]"
    )
