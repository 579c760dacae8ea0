"""SetParameters requests and answers as bytes, without messages in between, where that is simple.

A parameter message has a place for every type a value may have; writing and reading all of them was more work than the
rest of the call. Here are requests whose parameters hold one value each, and the answer that all went well. Everything
else, and everything unusual, takes the generated classes; both ways give the same bytes and values.

Source: protocol.md 2 and 9.2.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.msgs.rcl_interfaces import msg, srv
from rosidl_py_gen.runtime.endpoints.late_types import late_service_type
from rosidl_py_gen.runtime.parameters.messages import (
    asked_from_message,
    result_from_message,
    result_to_message,
    to_message,
)
from rosidl_py_gen.runtime.parameters.values import Parameter, ParameterType, ParameterValue, SetResult

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.runtime.endpoints.types import ServiceType
    from rosidl_py_gen.runtime.transport.interface import Payload

_BEGIN = struct.Struct("<HxxI")
_LENGTH = struct.Struct("<I")
_NUMBERS = struct.Struct("<qdI")  # integer, double, and the length of the string behind them
_EMPTY_ARRAYS = bytes(20)
_LITTLE_ENDIAN = 256  # the bytes 00 01
_SMALLEST = 46  # bytes of one parameter

SETTING = ("SetParameters", "SetParametersAtomically")
_SUCCESS = [SetResult(True)]
_SUCCESS_EACH = bytes.fromhex("00010000 01000000 01000000 01000000 00")
_SUCCESS_ALL = bytes.fromhex("00010000 01000000 01000000 00")


def set_service_type(name: str) -> ServiceType[Sequence[Parameter], Sequence[SetResult]]:
    """One of SETTING, with requests as parameters and responses as results, of which the atomic service has one."""
    known = late_service_type(f"rcl_interfaces/srv/{name}")
    atomic = name == "SetParametersAtomically"
    success = _SUCCESS_ALL if atomic else _SUCCESS_EACH

    def encode_request(parameters: Sequence[Parameter]) -> bytes:
        simple = simple_request(parameters)
        if simple is not None:
            return simple
        # Looked up here, where it is needed: importing it takes time that every node would spend at its start.
        request_class: Any = srv.SetParametersAtomically_Request if atomic else srv.SetParameters_Request
        return known.request.encode(request_class(parameters=[to_message(item) for item in parameters]))

    def decode_request(data: Payload) -> Sequence[Parameter]:
        simple = parse_simple_request(data)
        if simple is not None:
            return simple
        return [asked_from_message(item) for item in known.request.decode(data).parameters]

    def encode_response(results: Sequence[SetResult]) -> bytes:
        if len(results) == 1 and results[0].successful and not results[0].reason:
            return success
        found: list[msg.SetParametersResult] = [result_to_message(item) for item in results]
        response: Any = srv.SetParametersAtomically_Response(found[0]) if atomic else srv.SetParameters_Response(found)
        return known.response.encode(response)

    def decode_response(data: Payload) -> Sequence[SetResult]:
        # DDS pads to 4 bytes, and says so in the second half of the header.
        if data[4 : len(success)] == success[4:] and data[:2] == success[:2] and len(data) <= len(success) + 3:
            return _SUCCESS
        response = known.response.decode(data)
        return [result_from_message(item) for item in ([response.result] if atomic else response.results)]

    return replace(
        known,
        request=replace(known.request, encode=encode_request, decode=decode_request),
        response=replace(known.response, encode=encode_response, decode=decode_response),
    )


def simple_request(parameters: Sequence[Parameter]) -> bytes | None:
    """The bytes of a request; None when a value is an array or something else is unusual."""
    data = bytearray(_BEGIN.pack(_LITTLE_ENDIAN, len(parameters)))
    try:
        for parameter in parameters:
            kind, value = parameter.value.type, parameter.value.value
            if kind > ParameterType.STRING:
                return None
            name = parameter.name.encode()
            text = value.encode() if kind == ParameterType.STRING else b""  # type: ignore[union-attr]
            data += bytes(-len(data) & 3)
            data += _LENGTH.pack(len(name) + 1)
            data += name
            data += bytes((0, kind, kind == ParameterType.BOOL and bool(value)))
            data += bytes(4 - len(data) & 7)
            data += _NUMBERS.pack(
                value if kind == ParameterType.INTEGER else 0,
                value if kind == ParameterType.DOUBLE else 0.0,
                len(text) + 1,
            )
            data += text
            data.append(0)
            data += bytes(-len(data) & 3)
            data += _EMPTY_ARRAYS
    except (UnicodeEncodeError, struct.error):
        return None  # the generated classes know the words
    return bytes(data)


def parse_simple_request(data: Payload) -> list[Parameter] | None:
    """The parameters of a request; None when there are arrays in it or anything else is unusual."""
    if not isinstance(data, bytes) or len(data) < _BEGIN.size:
        return None
    begin, count = _BEGIN.unpack_from(data)
    if begin != _LITTLE_ENDIAN or _BEGIN.size + count * _SMALLEST > len(data) + 3:
        return None
    parameters = []
    pos = _BEGIN.size
    try:
        for _ in range(count):
            pos = pos + 3 & -4
            end = pos + 3 + _LENGTH.unpack_from(data, pos)[0]
            zero, kind, flag = data[end : end + 3]
            name = data[pos + 4 : end].decode()
            pos = (end + 6 & -8) + 4
            integer, double, length = _NUMBERS.unpack_from(data, pos)
            pos += 20
            end = pos + length - 1
            text = data[pos:end].decode()
            pos = end + 4 & -4
            if zero or data[end] or data[pos : pos + 20] != _EMPTY_ARRAYS or kind > ParameterType.STRING:
                return None
            pos += 20
            value = (None, flag != 0, integer, double, text)[kind]
            parameters.append(Parameter(name, ParameterValue(_KINDS[kind], value)))
    except (struct.error, IndexError, ValueError):  # too short, no UTF-8
        return None
    return parameters


_KINDS = tuple(ParameterType)
