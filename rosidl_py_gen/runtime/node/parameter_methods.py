"""The parameter methods of a node.

Decides names, defaults and the order in which a node brings up what every ROS node has
(docs/internals/protocol.md 9.1): parameter events, `use_sim_time`, the six services, logger levels, type description.
What each does is in its own file; what not every node needs is imported when it is first used.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, get_args, get_origin, overload

from rosidl_py_gen.base.registration import Registration, RegistrationSet
from rosidl_py_gen.runtime.loop.async_queue import AsyncQueue
from rosidl_py_gen.runtime.node.sim_time import TimeSource
from rosidl_py_gen.runtime.parameters.callbacks import require_plain
from rosidl_py_gen.runtime.parameters.overrides import overrides_for, sources_for
from rosidl_py_gen.runtime.parameters.store import ParameterStore
from rosidl_py_gen.runtime.parameters.validation import SEPARATOR, ListParametersResult
from rosidl_py_gen.runtime.parameters.values import (
    ARRAY_OF,
    TYPE_OF,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterEvent,
    ParameterType,
    PythonValue,
    SetResult,
    WrongParameterTypeError,
    as_parameters,
    as_prefixes,
    parameter_value,
    require_name,
    require_names,
)
from rosidl_py_gen.runtime.type_resolution.description_service import start_type_descriptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.node.arguments import NodeOptions
    from rosidl_py_gen.runtime.node.context import Context
    from rosidl_py_gen.runtime.parameters.client import ParameterClient, ParameterEvents
    from rosidl_py_gen.runtime.parameters.service import ParameterEventPublisher, ParameterService, ParameterServices
    from rosidl_py_gen.runtime.parameters.values import ParametersToSet
    from rosidl_py_gen.runtime.time.clock import Clock

T = TypeVar("T")
# bool stands before int, and int before float: type checkers accept the one where the other is expected.
ScalarT = TypeVar("ScalarT", bool, int, float, str, bytes)
ItemT = TypeVar("ItemT", bool, int, float, str)


class ParameterChange(NamedTuple):
    """One parameter that changed; `value` is None when it was unset or undeclared."""

    name: str
    value: PythonValue


class ParameterMethods:
    """Parameter methods of `Node`, which has to call `_open_parameters` in its constructor."""

    _scope: EntityScope
    context: Context
    clock: Clock
    _names: NodeNames
    _store: ParameterStore
    _changes: list[AsyncQueue[ParameterChange]]
    _event_callbacks: RegistrationSet[Callable[[ParameterEvent], object]]

    def _open_parameters(self, options: NodeOptions) -> None:
        """Bring up parameters and what depends on them, in rclpy's order; call it once `scope` and `clock` exist."""
        own = {item.name: item.value for item in as_parameters(options.parameter_overrides or {})}
        given = options.arguments.parameters
        if options.use_global_arguments:
            given = self.context._core.ros_arguments.parameters + given
        self._changes = changes = list[AsyncQueue[ParameterChange]]()
        self._event_callbacks = callbacks = RegistrationSet[Callable[[ParameterEvent], object]]()
        events: ParameterEventPublisher | None = None
        if options.parameter_events:
            from rosidl_py_gen.runtime.parameters.service import ParameterEventPublisher

            events = ParameterEventPublisher(self._scope, self._names, self.clock)

        def tell(event: ParameterEvent) -> None:
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

        self._store = ParameterStore(
            overrides_for(given, self._names.fully_qualified_name) | own,
            allow_undeclared=options.allow_undeclared_parameters,
            on_event=tell,
            on_failure=self._scope.report_failure,
        )
        self._store.sources.update(sources_for(given, self._names.fully_qualified_name))
        for name in own:
            self._store.sources.pop(name, None)
        if options.time_source:
            TimeSource(self._scope, self._names, self._store, self.clock)
        if options.automatically_declare_parameters_from_overrides:
            self._store.declare_overrides()
        if options.start_services:
            self._parameter_services().serve(self._names)
        if options.logger_services:
            from rosidl_py_gen.runtime.node.logger_levels import start_logger_services

            start_logger_services(self._scope, self._names)
        start_type_descriptions(self._scope, self._names, self._store)
        self.context._core.initial_values.opened(
            self._scope,
            self._store,
            own,
            options.arguments.parameters,
            self._may_declare_more,
            takes_global=options.use_global_arguments,
        )

    def _may_declare_more(self) -> bool:
        """Whether this is too early to wonder about initial values that no parameter takes."""
        return False

    # --------------------------------------------------------------------------------------------------- declaring

    def declare_parameters(
        self,
        cls: type[T],
        *,
        prefix: str = "",
        initial: T | None = None,
        validator: Callable[[T], str | None] | None = None,
    ) -> T:
        """Declare the fields of a dataclass; returns an object whose attributes follow, see `parameters/proxy.py`.

        Raises:
            ParameterClassError: an annotation cannot be a parameter, or a field has no default and nor has `initial`.
            ParameterError: a name is taken, an override has the wrong type or is refused. Nothing is declared then.
            TypeError: an argument has the wrong type; the validator is async.
        """
        from rosidl_py_gen.runtime.parameters.dataclass_binding import bind_class

        self._scope.require_open(False, "the node")
        return bind_class(self._store, cls, prefix=prefix, initial=initial, validator=validator)

    @overload
    def declare_parameter(
        self,
        name: str,
        default: ScalarT,
        descriptor: ParameterDescriptor | None = None,
        *,
        ignore_override: bool = False,
    ) -> ScalarT: ...
    @overload
    def declare_parameter(
        self,
        name: str,
        default: list[ItemT] | tuple[ItemT, ...],
        descriptor: ParameterDescriptor | None = None,
        *,
        ignore_override: bool = False,
    ) -> tuple[ItemT, ...]: ...
    @overload
    def declare_parameter(
        self,
        name: str,
        default: object = None,
        descriptor: ParameterDescriptor | None = None,
        *,
        ignore_override: bool = False,
    ) -> PythonValue: ...
    def declare_parameter(
        self,
        name: str,
        default: object = None,
        descriptor: ParameterDescriptor | None = None,
        *,
        ignore_override: bool = False,
    ) -> Any:
        """Declare one parameter and return its value, which is the override's if there is one.

        The value has the type of `default`; a list is returned as a tuple. Only with a descriptor of `dynamic_typing`
        an override may have another type.

        Raises:
            ParameterAlreadyDeclaredError, InvalidParameterNameError: the name is taken, or cannot be one.
            InvalidParameterValueError: a range, a callback or a missing type refuses it.
            WrongParameterTypeError: default or override have another type.
            TypeError: the descriptor is none, or one of its fields has the wrong type.
        """
        self._scope.require_open(False, "the node")
        value = parameter_value(default)
        return self._store.declare(name, value, descriptor, ignore_override=ignore_override).value

    def set_descriptor(self, name: str, descriptor: ParameterDescriptor, alternative: object = None) -> PythonValue:
        """Describe a parameter anew, and return its value.

        The descriptor's own name counts for nothing; without a type it keeps that of the parameter. Of an undeclared
        parameter nothing is kept, where those are allowed.

        Args:
            alternative: is set when the value that the parameter has does not fit; None: it has to.

        Raises:
            ParameterNotDeclaredError: nobody declared it. ParameterImmutableError: it is read-only so far.
            InvalidParameterValueError: neither value fits, a callback refuses the alternative, or a range makes no
                sense. TypeError: the descriptor is none, or one of its fields has the wrong type. Nothing changes then.
        """
        self._scope.require_open(False, "the node")
        value = parameter_value(alternative)
        return self._store.set_descriptor(require_name(name), descriptor, value).value

    def undeclare_parameter(self, name: str) -> None:
        """Forget a parameter; raises `ParameterNotDeclaredError`, `ParameterImmutableError` when it is read-only.

        The field of a dataclass keeps showing its last value, until a parameter of that name and type is declared.
        """
        self._scope.require_open(False, "the node")
        self._store.undeclare(require_name(name))

    def has_parameter(self, name: str) -> bool:
        """True when declared, with or without a value."""
        return self._store.has(require_name(name))

    # ----------------------------------------------------------------------------------------------------- reading

    @overload
    def get_parameter(self, name: str) -> PythonValue: ...
    @overload
    def get_parameter(self, name: str, type: type[T], default: T) -> T: ...
    @overload
    def get_parameter(self, name: str, type: type[T], default: None = None) -> T | None: ...
    def get_parameter(self, name: str, type: Any = None, default: Any = None) -> Any:
        """The value; `default` when the parameter is declared but unset.

        Args:
            type: ``bool``, ``int``, ``float``, ``str``, ``bytes``, or a list of one of the first four. None: any.

        Raises:
            ParameterNotDeclaredError: nobody declared it. WrongParameterTypeError: names both types.
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
        """Values as they are at one moment, in order; `get_parameter` is for one.

        Raises:
            ParameterNotDeclaredError, ParameterUninitializedError. TypeError: for a single text.
        """
        return [value.value for value in self._store.get_values(require_names(names))]

    def describe_parameter(self, name: str) -> ParameterDescriptor:
        """Raises `ParameterNotDeclaredError`."""
        return self._store.describe(require_name(name))

    def get_parameters_by_prefix(self, prefix: str = "") -> dict[str, Parameter]:
        """The parameters below a prefix, by their names without it; without a prefix all there are.

        They are those of one moment, and some may have no value. Of ``arm`` and ``arm.speed`` the prefix ``arm`` gives
        ``speed`` alone.
        """
        start = f"{require_name(prefix, 'a prefix')}{SEPARATOR}" if prefix else ""
        values = self._store.values().items()
        return {name[len(start) :]: Parameter(name, value) for name, value in values if name.startswith(start)}

    def list_parameters(self, prefixes: str | Sequence[str] = (), depth: int = 0) -> ListParametersResult:
        """Names and groups, all or those below one or several prefixes; depth 0 has no limit."""
        return self._store.listing(as_prefixes(prefixes), depth)

    # ----------------------------------------------------------------------------------------------------- setting

    def set_parameter(self, name: str, value: object) -> None:
        """Set one, from any thread.

        Raises:
            ParameterNotDeclaredError: nobody declared it. InvalidParameterValueError: it is refused; has the reason.
            CallbackAnswerError: a callback answered something it must not. ClosedError.
        """
        result = self.set_parameters_atomically({name: value}, require_declared=True)
        if not result.successful:
            raise InvalidParameterValueError(result.reason)

    def set_parameters(self, values: ParametersToSet, *, require_declared: bool = False) -> list[SetResult]:
        """Set one by one, from any thread; the result of each says whether and why not.

        Args:
            require_declared: raise for a name that nobody declared, unless those are allowed; what stands before it
                stays set, what stands behind it is not set. Otherwise its result is a refusal.

        Raises:
            InvalidParameterValueError: one is no parameter value; nothing is set then. TypeError: a name is no text.
            ParameterNotDeclaredError: with `require_declared`. ClosedError.
            CallbackAnswerError: a callback answered something it must not.
            Exception: whatever a callback raises that was added with `raises`.
        """
        return self._store.set_individually(self._coerce_empty_lists(values), require_declared=require_declared)

    def set_parameters_atomically(self, values: ParametersToSet, *, require_declared: bool = False) -> SetResult:
        """Set all or nothing, with one event; otherwise as `set_parameters`."""
        return self._store.set_atomically(self._coerce_empty_lists(values), require_declared=require_declared)

    def _coerce_empty_lists(self, values: ParametersToSet) -> list[Parameter]:
        """An empty list takes the type that was declared; raises `ClosedError`."""
        self._scope.require_open(False, "the node")
        fitted = []
        for parameter in as_parameters(values):
            value = parameter.value
            if value.value == b"" and self._store.has(parameter.name):
                kind = self._store.describe(parameter.name).type
                value = parameter_value((), kind) if kind.is_array else value
            fitted.append(Parameter(parameter.name, value))
        return fitted

    def add_pre_set_callback(
        self, callback: Callable[[list[Parameter]], list[Parameter]], *, raises: bool = False
    ) -> Registration:
        """May replace the list to set, until the answer is closed. Raises `TypeError` for an async function.

        It is called on the thread that sets, and other sets wait for it: it must not wait for the event loop.

        Args:
            raises: an exception in it goes on to whoever sets or declares, as in rclpy; of another node that sets, the
                set is refused. Otherwise it refuses every set, with a reason that says so, and the traceback is logged.
        """
        return self._store.callbacks.add("pre-set", callback, raises=raises)

    def add_on_set_callback(
        self, callback: Callable[[list[Parameter]], SetResult], *, raises: bool = False
    ) -> Registration:
        """May refuse a set, the newest is asked first; otherwise as `add_pre_set_callback`."""
        return self._store.callbacks.add("on-set", callback, raises=raises)

    def add_post_set_callback(
        self, callback: Callable[[list[Parameter]], None], *, raises: bool = False
    ) -> Registration:
        """Hears of each successful set and declaration, on the thread that set, until the answer is closed.

        Args:
            raises: an exception in it goes on to whoever set, once all have heard; the values stay. Otherwise it is
                logged.

        Raises:
            TypeError: for an async function.
        """
        return self._store.callbacks.add("post-set", callback, raises=raises)

    # ------------------------------------------------------------------------------------------------------ events

    def parameter_changes(self) -> AsyncQueue[ParameterChange]:
        """Every change of this node's parameters from now on, whoever makes it, in whatever thread."""
        stream: AsyncQueue[ParameterChange] = AsyncQueue()
        self._changes.append(stream)
        self._scope.register(stream)
        return stream

    def add_parameter_event_callback(self, callback: Callable[[ParameterEvent], object]) -> Registration:
        """Hears of each event of this node, as ``/parameter_events`` has it, until the answer is closed.

        Also without `parameter_events` of `Node`. It is called on the thread that sets, in the order of the sets, and
        other sets wait for it; what it raises is logged. Raises `TypeError` for an async function.
        """
        require_plain(callback, "the callback of parameter events", "the event")
        return self._event_callbacks.add(callback)

    def parameter_services(self) -> list[ParameterService]:
        """The six parameter services of this node as functions, to be served by other means than its own.

        Sets publish their events as always. With ``start_services=False`` the node does not serve them itself.
        """
        self._scope.require_open(False, "the node")
        return self._parameter_services().handlers()

    def _parameter_services(self) -> ParameterServices:
        from rosidl_py_gen.runtime.parameters.service import ParameterServices

        return ParameterServices(self._scope, self._store, self.context._core.initial_values.on_listed)

    def parameter_events(self, node: str | None = None) -> ParameterEvents:
        """What all nodes, or one of them, publish on ``/parameter_events`` from now on."""
        from rosidl_py_gen.runtime.parameters.client import ParameterEvents

        wanted = None if node is None else self._names.resolve_topic(require_name(node, "the name of a node"))
        return ParameterEvents(self._scope, self._names, wanted)

    def create_parameter_client(self, node: str) -> ParameterClient:
        """Get and set the parameters of another node, named like a topic (``/other``, ``other``)."""
        from rosidl_py_gen.runtime.parameters.client import ParameterClient

        self._scope.require_open(False, "the node")
        return ParameterClient(self._scope, self._names, require_name(node, "the name of a node"))


def _expected_type(wanted: Any) -> ParameterType:
    kind = TYPE_OF.get(wanted) if isinstance(wanted, type) else None
    if get_origin(wanted) in (list, tuple) and get_args(wanted):
        kind = ARRAY_OF.get(TYPE_OF.get(get_args(wanted)[0]))
    if kind is not None:
        return kind
    raise TypeError(
        f"{wanted!r} is no parameter type; expected bool, int, float, str, bytes or a list such as list[int]"
    )
