"""Reading all parameters of another node in batches.

A node answers with nothing at all if one parameter of a request is not declared, or, as rclcpp and rclpy do, has no
value. Such a batch is requested again without those that have no type, and then in halves. A batch grows as long as the
values in it are small: 100 000 numbers take about 100 requests, and a response has at most a few large texts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.msgs.rcl_interfaces.srv import GetParameters_Request, GetParameterTypes_Request
from rosidl_py_gen.runtime.entities.service_common import CallTimeoutError
from rosidl_py_gen.runtime.parameters.messages import value_from_message

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Sequence

    from rosidl_py_gen.runtime.entities.client import Client
    from rosidl_py_gen.runtime.parameters.values import ParameterValue
    from rosidl_py_gen.runtime.time.deadline import Deadline

_FIRST_BATCH = 50
_MAX_BATCH = 1000
_SMALL = 1 << 18
"""Size of the values of a response, in characters and elements, up to which the next batch is twice as large."""


async def read_all(
    names: Sequence[str], get: Client[Any, Any], types: Client[Any, Any], deadline: Deadline
) -> dict[str, ParameterValue]:
    """Return the values of the parameters that have one, in the order of the names.

    Raises:
        CallTimeoutError: a response did not arrive within the deadline, which is for all requests together.
    """

    async def values_of(batch: list[str]) -> list[Any]:
        return list((await get.call(GetParameters_Request(names=batch), deadline.remaining_s())).values)

    async def types_of(batch: list[str]) -> list[int]:
        return list((await types.call(GetParameterTypes_Request(names=batch), deadline.remaining_s())).types)

    result: dict[str, ParameterValue] = {}
    size, at = _FIRST_BATCH, 0
    while at < len(names):
        batch = list(names[at : at + size])
        at += len(batch)
        try:
            items = await _read_batch(batch, values_of, types_of)
        except CallTimeoutError:
            raise CallTimeoutError(f"{at - len(batch)} of {len(names)} parameters were read in time") from None
        values = {name: value_from_message(item) for name, item in items}
        result.update(values)
        contents = [value.value for value in values.values()]
        length = sum(len(content) for content in contents if isinstance(content, str | bytes | tuple))
        size = min(2 * size, _MAX_BATCH) if length <= _SMALL else max(1, size // 2)
    return {name: result[name] for name in names if name in result}


async def _read_batch(
    batch: list[str],
    values_of: Callable[[list[str]], Awaitable[list[Any]]],
    types_of: Callable[[list[str]], Awaitable[list[int]]],
) -> list[tuple[str, Any]]:
    items: list[tuple[str, Any]] = []
    pending = [batch]
    while pending:
        names = pending.pop()
        values = await values_of(names)
        if len(values) == len(names):
            items += zip(names, values, strict=True)
            continue
        kinds = await types_of(names)
        typed = [name for name, kind in zip(names, kinds, strict=False) if kind] if len(kinds) == len(names) else names
        middle = len(names) // 2
        if len(typed) < len(names):
            pending += [typed] if typed else []
        elif middle:
            pending += [names[:middle], names[middle:]]
    return items
