"""Client of the parameters of another node, through its six services and ``/parameter_events``.

Every call waits for the remote node, as part of `timeout_s`. An empty list has no type in Python and YAML, so before
an empty list is set, the client requests the type of the remote parameter. Nodes of rclcpp and rclpy refuse integers
for doubles, so if the node refuses an integer, the client requests the type, too, and sets the number again as a
double.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar, overload

from rosidl_py_gen.base.waiters import blocking
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.msgs.rcl_interfaces import msg, srv
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity
from rosidl_py_gen.runtime.entities.message_types import message_type, service_type
from rosidl_py_gen.runtime.entities.services import CallTimeoutError, Client
from rosidl_py_gen.runtime.entities.topics import Subscription
from rosidl_py_gen.runtime.loop.queues import AsyncQueue
from rosidl_py_gen.runtime.parameters.files import dump_parameters, read_parameter_file
from rosidl_py_gen.runtime.parameters.initial_values import ParameterFileError, overrides_for
from rosidl_py_gen.runtime.parameters.services import (
    descriptor_from_message,
    event_from_message,
    parameter_to_message,
    parameter_type,
    result_from_message,
    value_from_message,
)
from rosidl_py_gen.runtime.parameters.values import (
    ListParametersResult,
    Parameter,
    ParameterDescriptor,
    ParameterNotDeclaredError,
    ParameterType,
    ParameterValue,
    PythonValue,
    SetResult,
    as_names,
    as_parameters,
    parameter_value,
    widened,
)
from rosidl_py_gen.runtime.time_values import Deadline, Time, read_stamp
from rosidl_py_gen.runtime.transport.qos import PARAMETER_EVENTS, PARAMETERS

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names import NodeNames
    from rosidl_py_gen.runtime.parameters.values import ParameterEvent, ParametersToSet

_FIRST_BATCH = 50
_MAX_BATCH = 1000
_SMALL = 1 << 18
"""Size of the values in a response, in characters and elements, up to which the next request asks for twice as many
parameters."""
T = TypeVar("T")


class MalformedAnswerError(RosidlError):
    """Raised for a response of a remote node that does not fit the request, such as too few values."""


class RemoteParameterEvent(NamedTuple):
    """Event about parameters that a node published on ``/parameter_events``.

    Attributes:
        node: fully qualified name of the node.
        stamp: time of the change by the node's clock; None if the message has a negative time.
        event: changed parameters.
    """

    node: str
    stamp: Time | None
    event: ParameterEvent


class ParameterEvents(AsyncQueue[RemoteParameterEvent]):
    """Async iterator of the events about parameters of one node, or of all nodes; close the iterator after use."""

    def __init__(self, scope: EntityScope, names: NodeNames, node: str | None) -> None:
        super().__init__()
        self._scope = scope
        self._node = node
        topic = names.resolve_topic("/parameter_events")
        self._subscription: Subscription[msg.ParameterEvent] = Subscription(
            scope, message_type(msg.ParameterEvent), topic, self._on_message, PARAMETER_EVENTS
        )
        scope.register(self)

    def _on_message(self, message: msg.ParameterEvent) -> None:
        if self._node is None or message.node == self._node:
            self._push(RemoteParameterEvent(message.node, read_stamp(message.stamp), event_from_message(message)))

    async def wait_for_publishers(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until a publisher of ``/parameter_events`` is matched.

        Raises:
            WaitTimeoutError: no publisher was matched within `timeout_s`.
            ClosedError: the events or the node are closed, also while waiting.
        """
        return await self._subscription.wait_for_publishers(timeout_s)

    wait_for_publishers_sync = blocking(wait_for_publishers)

    def close(self, error: BaseException | None = None) -> None:
        """Stop receiving events; the iteration ends. May be called twice."""
        super().close(error)
        self._scope.unregister(self)
        self._subscription.close()


class ParameterClient(CompositeEntity):
    """Client of the parameters of another node, created by `Node.create_parameter_client`.

    Calls raise `CallTimeoutError` if no reply arrives within `timeout_s`, `ServerLostError` if the node disappears.
    """

    def __init__(self, scope: EntityScope, names: NodeNames, node: str) -> None:
        self.node: str = names.resolve_topic(node)
        """Fully qualified name of the remote node."""
        super().__init__(scope)
        self._names = names
        self._clients: list[Client[Any, Any]] = []

        def client(service: Any, name: str) -> Client[Any, Any]:
            topic = names.resolve_service(f"{self.node}/{name}")
            self._clients.append(Client(self._parts, service_type(service), topic, PARAMETERS))
            return self._clients[-1]

        self._get = client(srv.GetParameters, "get_parameters")
        self._types = client(srv.GetParameterTypes, "get_parameter_types")
        self._set = client(srv.SetParameters, "set_parameters")
        self._set_atomically = client(srv.SetParametersAtomically, "set_parameters_atomically")
        self._describe = client(srv.DescribeParameters, "describe_parameters")
        self._list = client(srv.ListParameters, "list_parameters")
        scope.register(self)

    async def wait_for_services(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until the remote node serves all six parameter services.

        Raises:
            WaitTimeoutError: at least one service did not appear within `timeout_s`.
            ClosedError: the client is closed, also while waiting.
        """

        def unavailable() -> list[Client[Any, Any]]:
            return [client for client in self._clients if not client._available()]

        def missing() -> str:
            names = ", ".join(client.name for client in unavailable())
            return f"node {self.node} does not serve its parameters: no server of {names} appeared"

        def why() -> str:
            return next((client._why_missing(client.name.removeprefix(self.node)) for client in unavailable()), "")

        return await self._scope.wait_or_raise(lambda: not unavailable(), timeout_s, missing, self, why=why)

    wait_for_services_sync = blocking(wait_for_services)

    @overload
    async def get(  # type: ignore[overload-overlap]  # a str is a sequence of str
        self, names: str, timeout_s: float | None = None
    ) -> PythonValue: ...
    @overload
    async def get(self, names: Sequence[str], timeout_s: float | None = None) -> list[PythonValue]: ...
    async def get(self, names: str | Sequence[str], timeout_s: float | None = None) -> PythonValue | list[PythonValue]:
        """Return the value of a remote parameter, or a list of values for a list of names; None if there is no value.

        Raises:
            ParameterNotDeclaredError: at least one parameter is not declared, or has no value.
            CallTimeoutError: no reply arrived within `timeout_s`.
            ServerLostError: the remote node disappeared.
            ClosedError: the client is closed.
        """
        requested = as_names(names)
        return self._select(names, requested, [item.value for item in await self._get_values(requested, timeout_s)])

    get_sync = blocking(get)

    @overload
    async def get_types(  # type: ignore[overload-overlap]  # a str is a sequence of str
        self, names: str, timeout_s: float | None = None
    ) -> ParameterType: ...
    @overload
    async def get_types(self, names: Sequence[str], timeout_s: float | None = None) -> list[ParameterType]: ...
    async def get_types(
        self, names: str | Sequence[str], timeout_s: float | None = None
    ) -> ParameterType | list[ParameterType]:
        """Return the type of a remote parameter, or a list of types for a list of names.

        Raises:
            ParameterNotDeclaredError: at least one parameter is not declared.
            CallTimeoutError: no reply arrived within `timeout_s`.
            ServerLostError: the remote node disappeared.
            ClosedError: the client is closed.
        """
        requested = as_names(names)
        return self._select(names, requested, await self._get_types(requested, timeout_s))

    get_types_sync = blocking(get_types)

    @overload
    async def describe(  # type: ignore[overload-overlap]  # a str is a sequence of str
        self, names: str, timeout_s: float | None = None
    ) -> ParameterDescriptor: ...
    @overload
    async def describe(self, names: Sequence[str], timeout_s: float | None = None) -> list[ParameterDescriptor]: ...
    async def describe(
        self, names: str | Sequence[str], timeout_s: float | None = None
    ) -> ParameterDescriptor | list[ParameterDescriptor]:
        """Return the descriptor of a remote parameter, or a list of descriptors for a list of names.

        Raises:
            ParameterNotDeclaredError: at least one parameter is not declared.
            CallTimeoutError: no reply arrived within `timeout_s`.
            ServerLostError: the remote node disappeared.
            ClosedError: the client is closed.
        """
        requested = as_names(names)
        return self._select(names, requested, await self._get_descriptors(requested, timeout_s))

    describe_sync = blocking(describe)

    def _select(self, names: str | Sequence[str], requested: list[str], items: list[T]) -> T | list[T]:
        """Return the items of a response for a list of names, or the only item for a single name.

        Raises:
            ParameterNotDeclaredError: the response is empty.
            MalformedAnswerError: the response has another number of items than the request has names.
        """
        if len(items) == len(requested):
            return items[0] if isinstance(names, str) else items
        if not items:
            raise ParameterNotDeclaredError(requested, self.node)
        raise MalformedAnswerError(f"{self.node} returned {len(items)} values for {len(requested)} parameters")

    async def _get_values(self, names: list[str], timeout_s: float | None) -> list[ParameterValue]:
        response = await self._get.call(srv.GetParameters.Request(names=names), timeout_s)
        return [value_from_message(item) for item in response.values]

    async def _get_types(self, names: list[str], timeout_s: float | None) -> list[ParameterType]:
        response = await self._types.call(srv.GetParameterTypes.Request(names=names), timeout_s)
        return [parameter_type(int(item)) for item in response.types]

    async def _get_descriptors(self, names: list[str], timeout_s: float | None) -> list[ParameterDescriptor]:
        response = await self._describe.call(srv.DescribeParameters.Request(names=names), timeout_s)
        return [descriptor_from_message(item) for item in response.descriptors]

    async def set(self, values: ParametersToSet, timeout_s: float | None = None) -> list[SetResult]:
        """Set remote parameters, each separately; return a result for each, with the node's reason if it refuses.

        An empty list takes the type of the remote parameter, which costs one or two more requests. A refused integer is
        set again as a double if the remote parameter is a double.

        Raises:
            InvalidParameterValueError: an object is not a parameter value.
            TypeError: a name is not a str.
            CallTimeoutError: no reply arrived within `timeout_s`.
            ServerLostError: the remote node disappeared.
            ClosedError: the client is closed.
        """
        deadline = Deadline(timeout_s)
        parameters = await self._with_array_types(as_parameters(values), deadline)
        results = await self._set_once(parameters, deadline)
        retries = {}
        for index, (parameter, result) in enumerate(zip(parameters, results, strict=False)):
            if not result.successful and (double := await self._as_double(parameter, deadline)) is not parameter:
                retries[index] = double
        if retries:
            for index, result in zip(retries, await self._set_once(list(retries.values()), deadline), strict=False):
                results[index] = result
        return results

    set_sync = blocking(set)

    async def _read_all(self, timeout_s: float | None) -> dict[str, ParameterValue]:
        """Return the values of all parameters of the remote node that have a value, by name.

        Raises:
            CallTimeoutError: a reply did not arrive within `timeout_s`, which is for all requests together.
        """
        deadline = Deadline(timeout_s)
        names = (await self.list(timeout_s=deadline.remaining_s())).names
        result: dict[str, ParameterValue] = {}
        size, at = _FIRST_BATCH, 0
        while at < len(names):
            batch = list(names[at : at + size])
            try:
                values = await self._read_batch(batch, deadline)
            except CallTimeoutError:
                raise CallTimeoutError(f"{at} of {len(names)} parameters were read in time") from None
            at += len(batch)
            result |= values
            contents = [value.value for value in values.values()]
            length = sum(len(content) for content in contents if isinstance(content, str | bytes | tuple))
            size = min(2 * size, _MAX_BATCH) if length <= _SMALL else max(1, size // 2)
        return result

    async def _read_batch(self, names: list[str], deadline: Deadline) -> dict[str, ParameterValue]:
        """Return the values of the requested parameters that have one, with further requests if necessary.

        A node returns no value at all if one of the requested parameters has no value.
        """
        values = await self._get_values(names, deadline.remaining_s())
        if len(values) == len(names):
            return dict(zip(names, values, strict=True))
        kinds, middle = await self._get_types(names, deadline.remaining_s()), len(names) // 2
        typed = [name for name, kind in zip(names, kinds, strict=False) if kind] if len(kinds) == len(names) else names
        if len(typed) < len(names):
            return await self._read_batch(typed, deadline) if typed else {}
        if not middle:
            return {}
        first = await self._read_batch(names[:middle], deadline)
        return first | await self._read_batch(names[middle:], deadline)

    async def _set_once(self, parameters: Sequence[Parameter], deadline: Deadline) -> list[SetResult]:
        request = srv.SetParameters.Request(parameters=[parameter_to_message(item) for item in parameters])
        return [result_from_message(item) for item in (await self._set.call(request, deadline.remaining_s())).results]

    async def set_atomically(self, values: ParametersToSet, timeout_s: float | None = None) -> SetResult:
        """Set all given remote parameters or none; return the result, with the node's reason if it refuses.

        An empty list takes the type of the remote parameter, which costs one or two more requests. Refused integers are
        set again as doubles if the remote parameters are doubles.

        Raises:
            InvalidParameterValueError: an object is not a parameter value.
            TypeError: a name is not a str.
            CallTimeoutError: no reply arrived within `timeout_s`.
            ServerLostError: the remote node disappeared.
            ClosedError: the client is closed.
        """
        deadline = Deadline(timeout_s)
        parameters = await self._with_array_types(as_parameters(values), deadline)
        result = await self._set_all(parameters, deadline)
        if result.successful:
            return result
        doubles = [await self._as_double(parameter, deadline) for parameter in parameters]
        return result if doubles == parameters else await self._set_all(doubles, deadline)

    set_atomically_sync = blocking(set_atomically)

    async def _set_all(self, parameters: Sequence[Parameter], deadline: Deadline) -> SetResult:
        request = srv.SetParametersAtomically.Request(parameters=[parameter_to_message(item) for item in parameters])
        return result_from_message((await self._set_atomically.call(request, deadline.remaining_s())).result)

    async def _as_double(self, parameter: Parameter, deadline: Deadline) -> Parameter:
        """Return the parameter with integers converted to doubles if the remote parameter is declared as double.

        Returns the parameter unchanged otherwise.
        """
        name, value = parameter
        if value.type not in (ParameterType.INTEGER, ParameterType.INTEGER_ARRAY):
            return parameter
        double = widened(value, await self._declared_type(name, deadline))
        return parameter if double is value else Parameter(name, double)

    async def _with_array_types(self, parameters: list[Parameter], deadline: Deadline) -> list[Parameter]:
        """Return the parameters, in which an empty list gets the array type of the remote parameter.

        An empty list is stored as an empty byte array, because its element type is unknown.
        """
        for index, parameter in enumerate(parameters):
            if parameter.value.value == b"":
                kind = await self._declared_type(parameter.name, deadline)
                if kind.is_array:
                    parameters[index] = Parameter(parameter.name, parameter_value((), kind))
        return parameters

    async def _declared_type(self, name: str, deadline: Deadline) -> ParameterType:
        """Return the type of a remote parameter; NOT_SET if the parameter is not declared or has no type."""
        kinds = await self._get_types([name], deadline.remaining_s())
        if kinds == [ParameterType.NOT_SET]:  # declared but unset: its descriptor may have a type
            kinds = [item.type for item in await self._get_descriptors([name], deadline.remaining_s())]
        return kinds[0] if len(kinds) == 1 else ParameterType.NOT_SET

    async def list(
        self, prefixes: str | Sequence[str] = (), depth: int = 0, timeout_s: float | None = None
    ) -> ListParametersResult:
        """Return the names and groups of the remote node's parameters.

        Args:
            prefixes: groups whose parameters are listed; empty: all parameters.
            depth: maximum number of parts of a name below the prefix; 0 is unlimited.
            timeout_s: None waits forever.

        Raises:
            CallTimeoutError: no reply arrived within `timeout_s`.
            ServerLostError: the remote node disappeared.
            ClosedError: the client is closed.
        """
        request = srv.ListParameters.Request(prefixes=as_names(prefixes, "prefixes"), depth=depth)
        result = (await self._list.call(request, timeout_s)).result
        return ListParametersResult(tuple(result.names), tuple(result.prefixes))

    list_sync = blocking(list)

    async def load_yaml(self, path: str | os.PathLike[str], timeout_s: float | None = None) -> dict[str, SetResult]:
        """Set the values that a parameter file has for the remote node, each separately; return the results by name.

        A read-only parameter that already has the value of the file counts as set, so that the text of `dump_yaml` can
        be loaded.

        Raises:
            ParameterFileError: the file is not a parameter file, or has no values for the remote node.
            OSError: the file cannot be read.
            CallTimeoutError: no reply arrived within `timeout_s`.
            ServerLostError: the remote node disappeared.
            ClosedError: the client is closed.
        """
        entries = read_parameter_file(Path(path))
        if not any(entry.matches(self.node) for entry in entries):
            patterns = ", ".join(dict.fromkeys(entry.pattern for entry in entries)) or "no node"
            raise ParameterFileError(f"{path}: no parameters for {self.node}; the file has parameters of {patterns}")
        values = {name: value for name, value in overrides_for(entries, self.node).items() if value.is_set}
        deadline = Deadline(timeout_s)
        results = await self.set([Parameter(name, value) for name, value in values.items()], deadline.remaining_s())
        return {
            name: result
            if result.successful
            else await self._ignore_unchanged_read_only(name, values[name], result, deadline)
            for name, result in zip(values, results, strict=False)
        }

    load_yaml_sync = blocking(load_yaml)

    async def _ignore_unchanged_read_only(
        self, name: str, value: ParameterValue, refused: SetResult, deadline: Deadline
    ) -> SetResult:
        """Return success for a refused parameter if it is read-only and already has the value of the file.

        Returns the refusal otherwise.
        """
        if not any(item.read_only for item in await self._get_descriptors([name], deadline.remaining_s())):
            return refused
        values = await self._get_values([name], deadline.remaining_s())
        if len(values) != 1:
            return refused
        actual = values[0]
        if value.value == b"" and actual.type.is_array:
            expected = parameter_value((), actual.type)
        else:
            expected = widened(value, actual.type)
        if repr(actual.value) == repr(expected.value):  # repr: NaN equals NaN, True does not equal 1
            return SetResult(True, "it is read-only and has this value")
        return SetResult(False, f"it is read-only with {actual.value!r:.100}; the file has {value.value!r:.100}")

    async def get_all(self, timeout_s: float | None = None) -> dict[str, PythonValue]:
        """Return the values of all remote parameters that have a value, by name.

        `timeout_s` is for all requests together.

        Raises:
            CallTimeoutError: no reply arrived within `timeout_s`.
            ServerLostError: the remote node disappeared.
            ClosedError: the client is closed.
        """
        return {name: value.value for name, value in (await self._read_all(timeout_s)).items()}

    get_all_sync = blocking(get_all)

    async def dump_yaml(self, timeout_s: float | None = None) -> str:
        """Return the text of a parameter file with the values of all remote parameters that have a value.

        Raises:
            CallTimeoutError: no reply arrived within `timeout_s`, which is for all requests together.
            ServerLostError: the remote node disappeared.
            ClosedError: the client is closed.
        """
        return dump_parameters(self.node, await self._read_all(timeout_s))

    dump_yaml_sync = blocking(dump_yaml)

    def events(self) -> ParameterEvents:
        """Return an iterator of the remote node's parameter events."""
        self._require_open()
        return ParameterEvents(self._parts, self._names, self.node)

    def _described(self) -> str:
        return f"the parameter client of {self.node}"
