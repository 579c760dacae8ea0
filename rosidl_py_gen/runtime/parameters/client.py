"""The parameters of another node, over its six services and ``/parameter_events``.

Decides how answers become values and errors. Every call waits for the remote node, as part of `timeout_s`.

One name gives one value, several give a list. An empty list says nothing about its type, in Python as in YAML, so
before one is set the remote node is asked which array type the parameter has. Nodes of rclcpp and rclpy refuse whole
numbers for doubles, so when one was refused, it is asked, too, and the number set again as a double.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar, overload

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.msgs.rcl_interfaces.msg import ParameterEvent as EventMessage
from rosidl_py_gen.msgs.rcl_interfaces.srv import (
    DescribeParameters,
    DescribeParameters_Request,
    GetParameters,
    GetParameters_Request,
    GetParameterTypes,
    GetParameterTypes_Request,
    ListParameters,
    ListParameters_Request,
    SetParameters,
    SetParameters_Request,
    SetParametersAtomically,
    SetParametersAtomically_Request,
)
from rosidl_py_gen.runtime.entities.client import Client
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity
from rosidl_py_gen.runtime.entities.message_types import message_type, service_type
from rosidl_py_gen.runtime.entities.subscription import Subscription
from rosidl_py_gen.runtime.loop.async_queue import AsyncQueue
from rosidl_py_gen.runtime.loop.blocking import blocking
from rosidl_py_gen.runtime.parameters.batches import read_all
from rosidl_py_gen.runtime.parameters.files import read_parameter_file
from rosidl_py_gen.runtime.parameters.messages import (
    descriptor_from_message,
    event_from_message,
    parameter_type,
    result_from_message,
    to_message,
    value_from_message,
)
from rosidl_py_gen.runtime.parameters.overrides import ParameterFileError, overrides_for
from rosidl_py_gen.runtime.parameters.validation import ListParametersResult
from rosidl_py_gen.runtime.parameters.values import (
    Parameter,
    ParameterDescriptor,
    ParameterNotDeclaredError,
    ParameterType,
    ParameterValue,
    PythonValue,
    SetResult,
    as_parameters,
    as_prefixes,
    parameter_value,
    require_names,
    widened,
)
from rosidl_py_gen.runtime.parameters.writing import dump_parameters
from rosidl_py_gen.runtime.time.deadline import Deadline
from rosidl_py_gen.runtime.time.values import Time, read_stamp
from rosidl_py_gen.runtime.transport.qos import PARAMETER_EVENTS, PARAMETERS

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterEvent
    from rosidl_py_gen.runtime.parameters.values import ParametersToSet

T = TypeVar("T")


class MalformedAnswerError(RosidlError):
    """The remote node answered something that does not belong to the question."""


class RemoteParameterEvent(NamedTuple):
    """Event that a node sent on ``/parameter_events``; `stamp` is None where it was negative."""

    node: str
    stamp: Time | None
    event: ParameterEvent


class ParameterEvents(AsyncQueue[RemoteParameterEvent]):
    """An async iterator of parameter events; close it when it is no longer needed."""

    def __init__(self, scope: EntityScope, names: NodeNames, node: str | None) -> None:
        """`node` None means all nodes."""
        super().__init__()
        self._scope = scope
        self._node = node
        topic = names.resolve_topic("/parameter_events")
        self._subscription: Subscription[EventMessage] = Subscription(
            scope, message_type(EventMessage), topic, self._arrived, PARAMETER_EVENTS
        )
        scope.register(self)

    def _arrived(self, message: EventMessage) -> None:
        if self._node is None or message.node == self._node:
            self._push(RemoteParameterEvent(message.node, read_stamp(message.stamp), event_from_message(message)))

    async def wait_for_publishers(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until somebody is there to be heard; raises `WaitTimeoutError` when the time passed."""
        return await self._subscription.wait_for_publishers(timeout_s)

    wait_for_publishers_sync = blocking(wait_for_publishers)

    def close(self, error: BaseException | None = None) -> None:
        """Stop listening; the iterator ends. May be called twice."""
        super().close(error)
        self._scope.unregister(self)
        self._subscription.close()


class _NameQuery:
    """One name or several, and the answer that belongs to them."""

    def __init__(self, node: str, names: str | Sequence[str]) -> None:
        self._node = node
        self._single = isinstance(names, str)
        self.names = [names] if isinstance(names, str) else require_names(names)

    def answer(self, found: list[T]) -> T | list[T]:
        """One for one name, a list for several; raises `ParameterNotDeclaredError`, `MalformedAnswerError`."""
        if len(found) == len(self.names):
            return found[0] if self._single else found
        if not found:
            raise ParameterNotDeclaredError(self.names, self._node)
        raise MalformedAnswerError(f"{self._node} answered {len(found)} values for {len(self.names)} parameters")


class ParameterClient(CompositeEntity):
    """Made by `create_parameter_client`.

    Calls raise `CallTimeoutError` when no answer comes in `timeout_s` seconds, `ServerLostError` when the node leaves.
    """

    def __init__(self, scope: EntityScope, names: NodeNames, node: str) -> None:
        self.node = names.resolve_topic(node)
        """Fully qualified name of the remote node."""
        super().__init__(scope)
        self._names = names
        self._clients: list[Client[Any, Any]] = []

        def client(service: Any, name: str) -> Client[Any, Any]:
            topic = names.resolve_service(f"{self.node}/{name}")
            self._clients.append(Client(self._parts, service_type(service), topic, PARAMETERS))
            return self._clients[-1]

        self._get = client(GetParameters, "get_parameters")
        self._types = client(GetParameterTypes, "get_parameter_types")
        self._set = client(SetParameters, "set_parameters")
        self._set_atomically = client(SetParametersAtomically, "set_parameters_atomically")
        self._describe = client(DescribeParameters, "describe_parameters")
        self._list = client(ListParameters, "list_parameters")
        scope.register(self)

    async def wait_for_services(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until the remote node serves its parameters; raises `WaitTimeoutError` when the time passed."""

        def unserved() -> list[Client[Any, Any]]:
            return [client for client in self._clients if not client.service_is_available()]

        def missing() -> str:
            names = ", ".join(client.name for client in unserved())
            return f"node {self.node} does not serve its parameters: no server of {names} appeared"

        def why() -> str:
            return next((one._why_missing(one.name.removeprefix(self.node)) for one in unserved()), "")

        return await self._scope.wait_or_raise(
            lambda: not unserved(), timeout_s, lambda: self._closed, missing, why=why
        )

    wait_for_services_sync = blocking(wait_for_services)

    @overload
    async def get(  # type: ignore[overload-overlap]  # a text is a sequence of texts
        self, names: str, timeout_s: float | None = None
    ) -> PythonValue: ...
    @overload
    async def get(self, names: Sequence[str], timeout_s: float | None = None) -> list[PythonValue]: ...
    async def get(self, names: str | Sequence[str], timeout_s: float | None = None) -> PythonValue | list[PythonValue]:
        """One value for one name, a list for several; None where nothing is set.

        Raises:
            ParameterNotDeclaredError: at least one of them is not declared, or has no value.
        """
        asked = _NameQuery(self.node, names)
        response = await self._get.call(GetParameters_Request(names=asked.names), timeout_s)
        return asked.answer([value_from_message(item).value for item in response.values])

    @overload
    def get_sync(  # type: ignore[overload-overlap]  # a text is a sequence of texts
        self, names: str, timeout_s: float | None = None
    ) -> PythonValue: ...
    @overload
    def get_sync(self, names: Sequence[str], timeout_s: float | None = None) -> list[PythonValue]: ...
    def get_sync(self, names: Any, timeout_s: float | None = None) -> Any:
        """`get` for plain code; raises `WouldDeadlockError` on the event loop's thread."""
        return self._scope.run_blocking(self.get(names, timeout_s), f"get_sync of {self!r}", "'await ...get(...)'")

    @overload
    async def get_types(  # type: ignore[overload-overlap]  # a text is a sequence of texts
        self, names: str, timeout_s: float | None = None
    ) -> ParameterType: ...
    @overload
    async def get_types(self, names: Sequence[str], timeout_s: float | None = None) -> list[ParameterType]: ...
    async def get_types(
        self, names: str | Sequence[str], timeout_s: float | None = None
    ) -> ParameterType | list[ParameterType]:
        """One type for one name, a list for several; raises `ParameterNotDeclaredError` as `get`."""
        asked = _NameQuery(self.node, names)
        response = await self._types.call(GetParameterTypes_Request(names=asked.names), timeout_s)
        return asked.answer([parameter_type(int(item)) for item in response.types])

    @overload
    def get_types_sync(  # type: ignore[overload-overlap]  # a text is a sequence of texts
        self, names: str, timeout_s: float | None = None
    ) -> ParameterType: ...
    @overload
    def get_types_sync(self, names: Sequence[str], timeout_s: float | None = None) -> list[ParameterType]: ...
    def get_types_sync(self, names: Any, timeout_s: float | None = None) -> Any:
        """`get_types` for plain code; raises `WouldDeadlockError` on the event loop's thread."""
        return self._scope.run_blocking(
            self.get_types(names, timeout_s), f"get_types_sync of {self!r}", "'await ...types(...)'"
        )

    @overload
    async def describe(  # type: ignore[overload-overlap]  # a text is a sequence of texts
        self, names: str, timeout_s: float | None = None
    ) -> ParameterDescriptor: ...
    @overload
    async def describe(self, names: Sequence[str], timeout_s: float | None = None) -> list[ParameterDescriptor]: ...
    async def describe(
        self, names: str | Sequence[str], timeout_s: float | None = None
    ) -> ParameterDescriptor | list[ParameterDescriptor]:
        """One for one name, a list for several; raises `ParameterNotDeclaredError` when one is not declared there."""
        asked = _NameQuery(self.node, names)
        response = await self._describe.call(DescribeParameters_Request(names=asked.names), timeout_s)
        return asked.answer([descriptor_from_message(item) for item in response.descriptors])

    @overload
    def describe_sync(  # type: ignore[overload-overlap]  # a text is a sequence of texts
        self, names: str, timeout_s: float | None = None
    ) -> ParameterDescriptor: ...
    @overload
    def describe_sync(self, names: Sequence[str], timeout_s: float | None = None) -> list[ParameterDescriptor]: ...
    def describe_sync(self, names: Any, timeout_s: float | None = None) -> Any:
        """`describe` for plain code; raises `WouldDeadlockError` on the event loop's thread."""
        return self._scope.run_blocking(
            self.describe(names, timeout_s), f"describe_sync of {self!r}", "'await ...describe(...)'"
        )

    async def set(self, values: ParametersToSet, timeout_s: float | None = None) -> list[SetResult]:
        """Set one by one; the result of each says whether and why not.

        An empty list takes the type the remote parameter has, which costs one or two more questions for each. A whole
        number that is refused is set again as a double where the parameter is one.

        Raises:
            InvalidParameterValueError: one is no parameter value. TypeError: a name is no text.
        """
        deadline = Deadline(timeout_s)
        wanted = await self._fitted(as_parameters(values), deadline)
        results = await self._set_once(wanted, deadline)
        refused = [index for index, result in enumerate(results[: len(wanted)]) if not result.successful]
        tried = {index: await self._as_double(wanted[index], deadline) for index in refused}
        again = {index: parameter for index, parameter in tried.items() if parameter is not wanted[index]}
        if again:
            second = await self._set_once(list(again.values()), deadline)
            for index, result in zip(again, second, strict=False):
                results[index] = result
        return results

    set_sync = blocking(set)

    async def _read_all(self, timeout_s: float | None) -> dict[str, ParameterValue]:
        deadline = Deadline(timeout_s)
        return await read_all(
            (await self.list(timeout_s=deadline.remaining_s())).names, self._get, self._types, deadline
        )

    async def _set_once(self, wanted: Sequence[Parameter], deadline: Deadline) -> list[SetResult]:
        request = SetParameters_Request(parameters=[to_message(item) for item in wanted])
        return [result_from_message(item) for item in (await self._set.call(request, deadline.remaining_s())).results]

    async def set_atomically(self, values: ParametersToSet, timeout_s: float | None = None) -> SetResult:
        """Set all or nothing; otherwise as `set`."""
        deadline = Deadline(timeout_s)
        wanted = await self._fitted(as_parameters(values), deadline)
        result = await self._set_all(wanted, deadline)
        if result.successful:
            return result
        again = [await self._as_double(one, deadline) for one in wanted]
        return result if again == wanted else await self._set_all(again, deadline)

    set_atomically_sync = blocking(set_atomically)

    async def _set_all(self, wanted: Sequence[Parameter], deadline: Deadline) -> SetResult:
        request = SetParametersAtomically_Request(parameters=[to_message(item) for item in wanted])
        return result_from_message((await self._set_atomically.call(request, deadline.remaining_s())).result)

    async def _as_double(self, parameter: Parameter, deadline: Deadline) -> Parameter:
        """The parameter itself, unless it is of whole numbers and the remote one of doubles."""
        name, value = parameter
        if value.type not in (ParameterType.INTEGER, ParameterType.INTEGER_ARRAY):
            return parameter
        double = widened(value, await self._declared_type(name, deadline))
        return parameter if double is value else Parameter(name, double)

    async def _fitted(self, parameters: list[Parameter], deadline: Deadline) -> list[Parameter]:
        """Empty lists, which came here as empty byte arrays, get the array type of the remote parameter."""
        for index, parameter in enumerate(parameters):
            if parameter.value.value == b"":
                kind = await self._declared_type(parameter.name, deadline)
                if kind.is_array:
                    parameters[index] = Parameter(parameter.name, parameter_value((), kind))
        return parameters

    async def _declared_type(self, name: str, deadline: Deadline) -> ParameterType:
        """NOT_SET when the parameter is not declared."""
        typed = await self._types.call(GetParameterTypes_Request(names=[name]), deadline.remaining_s())
        kind = parameter_type(int(typed.types[0])) if len(typed.types) == 1 else ParameterType.NOT_SET
        if kind is ParameterType.NOT_SET and len(typed.types) == 1:
            # Declared but unset: the descriptor may know.
            described = await self._describe.call(DescribeParameters_Request(names=[name]), deadline.remaining_s())
            kind = parameter_type(described.descriptors[0].type) if len(described.descriptors) == 1 else kind
        return kind

    async def list(
        self, prefixes: str | Sequence[str] = (), depth: int = 0, timeout_s: float | None = None
    ) -> ListParametersResult:
        """Names and groups, all or those below one or several prefixes; depth 0 has no limit."""
        request = ListParameters_Request(prefixes=as_prefixes(prefixes), depth=depth)
        result = (await self._list.call(request, timeout_s)).result
        return ListParametersResult(tuple(result.names), tuple(result.prefixes))

    list_sync = blocking(list)

    async def load_yaml(self, path: str | os.PathLike[str], timeout_s: float | None = None) -> dict[str, SetResult]:
        """Set what a parameter file says for the remote node, with the types of `set`.

        What is read-only there is set, too, as far as its result says, where it has that value already: so what
        `dump_yaml` wrote can be loaded.

        Raises:
            ParameterFileError: it is not a parameter file, or has nothing for the remote node.
            OSError: it cannot be read.
        """
        entries = read_parameter_file(Path(path))
        if not any(entry.matches(self.node) for entry in entries):
            named = ", ".join(dict.fromkeys(entry.pattern for entry in entries)) or "no node at all"
            raise ParameterFileError(f"{path}: nothing for {self.node}; the file has parameters of {named}")
        found = overrides_for(entries, self.node)
        deadline = Deadline(timeout_s)
        results = await self.set([Parameter(name, value) for name, value in found.items()], deadline.remaining_s())
        return {
            name: result
            if result.successful
            else await self._ignore_unchanged_read_only(name, found[name], result, deadline)
            for name, result in zip(found, results, strict=False)
        }

    load_yaml_sync = blocking(load_yaml)

    async def _ignore_unchanged_read_only(
        self, name: str, wanted: ParameterValue, refused: SetResult, deadline: Deadline
    ) -> SetResult:
        """What a file wants of a parameter that nobody may set is fine if that is its value."""
        described = await self._describe.call(DescribeParameters_Request(names=[name]), deadline.remaining_s())
        if len(described.descriptors) != 1 or not described.descriptors[0].read_only:
            return refused
        response = await self._get.call(GetParameters_Request(names=[name]), deadline.remaining_s())
        if len(response.values) != 1:
            return refused
        has = value_from_message(response.values[0])
        if repr(has.value) == repr(_as_type_of(wanted, has.type).value):  # NaN is itself, True is not 1
            return SetResult(True, "it is read-only and has this value")
        return SetResult(False, f"it is read-only and stays {has.value!r:.100}, the file says {wanted.value!r:.100}")

    async def get_all(self, timeout_s: float | None = None) -> dict[str, PythonValue]:
        """Return the values of all parameters that have one, by name; `timeout_s` is for all requests together."""
        return {name: value.value for name, value in (await self._read_all(timeout_s)).items()}

    get_all_sync = blocking(get_all)

    async def dump_yaml(self, timeout_s: float | None = None) -> str:
        """Return the text of a parameter file with all values of the remote node; otherwise as `get_all`."""
        return dump_parameters(self.node, await self._read_all(timeout_s))

    dump_yaml_sync = blocking(dump_yaml)

    def events(self) -> ParameterEvents:
        """What happens to the remote node's parameters from now on."""
        self._scope.require_open(self._closed, f"the parameter client of {self.node}")
        return ParameterEvents(self._parts, self._names, self.node)


def _as_type_of(value: ParameterValue, kind: ParameterType) -> ParameterValue:
    """What a file means where a parameter of this type is: see `ParameterClient.set`."""
    return parameter_value((), kind) if value.value == b"" and kind.is_array else widened(value, kind)
