"""Foxglove WebSocket protocol without I/O: parses messages of viewers, and formats messages to viewers.

Text messages are JSON with an ``op``; binary ones begin with an opcode, and are little-endian. Source: the published
specification of `foxglove.websocket.v1`; `foxglove.sdk.v1` is the newer name in the SDK.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import reprlib
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.errors import RosidlError, printable
from rosidl_py_gen.foxglove.limits import MAX_ENTRIES, MAX_NAME, MAX_STATUS_LENGTH, MAX_TEXT, MAX_VALUES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
WARNING = 1
ERROR = 2
_MESSAGE, _TIME, _RESPONSE = struct.Struct("<BIQ"), struct.Struct("<BQ"), struct.Struct("<BIII")
_PUBLISHED, _CALL = struct.Struct("<I"), struct.Struct("<III")
_CDR, _SCHEMA = "cdr", "ros2msg"


class ProtocolError(RosidlError):
    """Raised for a message of a viewer that is invalid, or not permitted in the current state."""


@dataclass(frozen=True, slots=True, eq=False)
class ClientAdvertisement:
    """Topic on which a viewer wants to publish; advertising the topic again creates a new object."""

    topic: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


class ServiceCallRequest(NamedTuple):
    """Call of a service by a viewer: id of the service, number of the call, encoding and bytes of the request."""

    service: int
    number: int
    encoding: str
    data: bytes


class ClientMessage(NamedTuple):
    """Parsed message of a viewer.

    Attributes:
        op: operation, named as in JSON; `publish` and `call` for binary messages.
        what: contents: for `subscribe`, ids of subscriptions and channels; for `advertise`, ids of channels and their
            `ClientAdvertisement`; for `unsubscribe` and `unadvertise`, ids; for `publish`, id of a channel and data;
            for `call`, a `ServiceCallRequest`; for parameters, their names, or names and values to set.
        id: id of a parameter request that expects a reply.
    """

    op: str
    what: Any
    id: str | None = None


def read(message: str | bytes) -> ClientMessage:
    """Parse a message of a viewer; raises `ProtocolError` if the message is invalid."""
    try:
        if isinstance(message, bytes):
            return _read_bytes(message)
        if len(message) > MAX_TEXT:
            raise ValueError(f"got a text of {len(message)} characters, expected at most {MAX_TEXT}")
        fields = json.loads(message, parse_constant=_no_number, parse_int=_integer)
        key, read_one = OPERATIONS[fields["op"]]
        what = [read_one(one) for one in _entries(key, fields[key])] if key else None
        if fields["op"] == "setParameters":
            _require_few_values(what or [])
        return ClientMessage(fields["op"], what, None if fields.get("id") is None else _name(fields["id"]))
    except KeyError as missing:
        raise ProtocolError(f"Invalid message: there is no {_short(missing.args[0])}") from None
    except (TypeError, ValueError, IndexError, RecursionError, struct.error) as error:
        raise ProtocolError(f"Invalid message: {printable(str(error), 200)}") from None


def _read_bytes(message: bytes) -> ClientMessage:
    if message[0] == 1:
        return ClientMessage("publish", (*_PUBLISHED.unpack_from(message, 1), message[1 + _PUBLISHED.size :]))
    if message[0] != 2:
        raise ValueError(f"no opcode {message[0]}")
    service, number, length = _CALL.unpack_from(message, 1)
    begin = 1 + _CALL.size
    end = begin + length
    if length > MAX_NAME:
        raise ValueError(f"got an encoding of {length} bytes, expected at most {MAX_NAME}")
    return ClientMessage("call", ServiceCallRequest(service, number, message[begin:end].decode(), message[end:]))


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is not a number of JSON")


def _integer(text: str) -> int:
    """Parse an integer of JSON; raises ValueError for more than 64 bits, because parsing takes quadratic time."""
    if len(text) > 20 or not -(1 << 63) <= (value := int(text)) < 1 << 63:
        raise ValueError(f"got the number {text:.30} of {len(text)} digits, expected -2^63 to 2^63 - 1")
    return value


def _short(value: Any) -> str:
    """Return the `repr` of a value, cut to 50 characters, in bounded time also for a large list."""
    return f"{reprlib.repr(value):.50}"


def _number(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 1 << 32:
        raise ValueError(f"expected a number from 0 to {(1 << 32) - 1}, found {_short(value)}")
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"expected a text, found {_short(value)}")
    return value


def _name(value: Any) -> str:
    if len(_text(value)) > MAX_NAME:
        raise ValueError(f"got {_short(value)} of {len(value)} characters, expected at most {MAX_NAME}")
    return value  # type: ignore[no-any-return]


def _entries(key: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"expected a list, found {_short(value)}")
    if len(value) > MAX_ENTRIES:
        raise ValueError(f"got {len(value)} {key}, expected at most {MAX_ENTRIES} in a message; send several")
    return value


def _require_few_values(values: list[tuple[str, Any]]) -> None:
    count = sum(len(value) for _, value in values if isinstance(value, list))
    if count > MAX_VALUES:
        raise ValueError(f"got {count} values in lists, expected at most {MAX_VALUES} in a message")


def _advertisement(one: Mapping[str, Any]) -> tuple[int, ClientAdvertisement]:
    topic, encoding, name = (_name(one[key]) for key in ("topic", "encoding", "schemaName"))
    schema_encoding, schema = _name(one.get("schemaEncoding") or ""), _text(one.get("schema") or "")
    return _number(one["id"]), ClientAdvertisement(topic, encoding, name, schema_encoding, schema.encode())


def _parameter(one: Mapping[str, Any]) -> tuple[str, Any]:
    name, value = _name(one["name"]), one.get("value")
    if one.get("type") == "byte_array":
        try:
            value = base64.b64decode(_text(value), validate=True)
        except binascii.Error as error:
            raise ValueError(f"{_short(name)} is not base64: {error}") from None
    for item in value if isinstance(value, list) else (value,):
        if isinstance(item, list | dict) or (item is None and value is not None):
            raise ValueError(f"a parameter has a value, or a list of values, not {_short(value)}")
        if isinstance(item, float) and not math.isfinite(item):
            raise ValueError(f"the number for {_short(name)} is beyond the range of a double")
    return name, value


OPERATIONS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "subscribe": ("subscriptions", lambda one: (_number(one["id"]), _number(one["channelId"]))),
    "unsubscribe": ("subscriptionIds", _number),
    "advertise": ("channels", _advertisement),
    "unadvertise": ("channelIds", _number),
    "getParameters": ("parameterNames", _name),
    "setParameters": ("parameters", _parameter),
    "subscribeParameterUpdates": ("parameterNames", _name),
    "unsubscribeParameterUpdates": ("parameterNames", _name),
    "subscribeConnectionGraph": ("", _text),
    "unsubscribeConnectionGraph": ("", _text),
    "fetchAsset": ("", _text),
}
"""Operations of text messages from viewers, each with the key of the list in the message and the parser of an element.
"""


def control(op: str, **fields: Any) -> str:
    """Return a text message to a viewer: JSON with the operation `op` and `fields`."""
    return json.dumps({"op": op, **fields}, separators=(",", ":"), allow_nan=False)


def status(text: str, level: int = WARNING) -> str:
    """Return a status message to a viewer as JSON; `level` is `WARNING` or `ERROR`."""
    return control("status", level=level, message=printable(text, MAX_STATUS_LENGTH))


def channel(number: int, topic: str, type_name: str, definition: str) -> dict[str, Any]:
    """Return the entry of an `advertise` message for a topic of CDR messages."""
    named = {"id": number, "topic": topic, "encoding": _CDR, "schemaName": type_name}
    return {**named, "schema": definition, "schemaEncoding": _SCHEMA}


def service(number: int, name: str, type_name: str, texts: tuple[str, str]) -> dict[str, Any]:
    """Return the entry of an `advertiseServices` message for a service; `texts` define request and response."""
    halves = {
        half.lower(): {"encoding": _CDR, "schemaName": f"{type_name}_{half}", "schemaEncoding": _SCHEMA, "schema": text}
        for half, text in zip(("Request", "Response"), texts, strict=True)
    }
    return {"id": number, "name": name, "type": type_name, **halves}


def message_data(subscription: int, time_ns: int, data: bytes) -> bytes:
    """Return the binary message that sends a message of a topic to a viewer."""
    return _MESSAGE.pack(1, subscription, time_ns) + data


def time(time_ns: int) -> bytes:
    """Return the binary message that sends the time of the server to a viewer."""
    return _TIME.pack(2, time_ns)


def response(call: ServiceCallRequest, data: bytes) -> bytes:
    """Return the binary message that sends the response of a service to a viewer, in the encoding of the request."""
    encoding = call.encoding.encode()
    return _RESPONSE.pack(3, call.service, call.number, len(encoding)) + encoding + data


def failure(call: ServiceCallRequest, text: str) -> str:
    """Return the text message that reports to a viewer why its service call failed."""
    return control(
        "serviceCallFailure", serviceId=call.service, callId=call.number, message=printable(text, MAX_STATUS_LENGTH)
    )


def parameter_values(values: Mapping[str, Any], id: str | None = None) -> str:
    """Return the text message with values of parameters, without unset ones; `id` is the id of the request."""
    parameters = [{"name": name, **_value(value)} for name, value in values.items() if value is not None]
    return control("parameterValues", parameters=parameters, **({} if id is None else {"id": id}))


def _value(value: Any) -> dict[str, Any]:
    """Return the JSON fields of a parameter value, with its type if JSON does not imply it; NaN becomes null."""
    if isinstance(value, bytes):
        return {"type": "byte_array", "value": base64.b64encode(value).decode()}
    if isinstance(value, float):
        return {"type": "float64", "value": value if math.isfinite(value) else None}
    if isinstance(value, tuple | list) and value and isinstance(value[0], float):
        return {"type": "float64_array", "value": [one if math.isfinite(one) else None for one in value]}
    return {"value": value}


Graph = tuple[dict[str, list[str]], dict[str, list[str]], dict[str, list[str]]]
"""Connection graph: publishing nodes by topic, subscribing nodes by topic, and serving nodes by service."""
NO_GRAPH: Graph = ({}, {}, {})


def graph_update(before: Graph, now: Graph) -> str:
    """Return the text message with the difference of two connection graphs."""
    changed = [
        [{"name": name, key: new.get(name, [])} for name in old | new if old.get(name) != new.get(name)]
        for old, new, key in zip(before, now, ("publisherIds", "subscriberIds", "providerIds"), strict=True)
    ]
    return control(
        "connectionGraphUpdate",
        **dict(zip(("publishedTopics", "subscribedTopics", "advertisedServices"), changed, strict=True)),
        removedTopics=[name for name in before[0] | before[1] if name not in now[0] and name not in now[1]],
        removedServices=[name for name in before[2] if name not in now[2]],
    )
