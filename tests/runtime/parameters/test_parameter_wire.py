"""The short way through SetParameters gives the bytes and values of the generated classes, and of protocol.md."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.errors import DecodeError, EncodeError
from rosidl_py_gen.msgs.rcl_interfaces import srv
from rosidl_py_gen.runtime.parameters.messages import from_message, result_to_message, to_message
from rosidl_py_gen.runtime.parameters.values import Parameter, ParameterType, ParameterValue, SetResult, parameter_value
from rosidl_py_gen.runtime.parameters.wire import SETTING, parse_simple_request, set_service_type, simple_request

TEXTS = st.text(st.characters(codec="utf-8"), max_size=12)
SIMPLE = st.one_of(st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), TEXTS, st.none())
ARRAYS = st.one_of(
    st.lists(st.booleans(), max_size=3),
    st.lists(st.integers(-(2**63), 2**63 - 1), max_size=3),
    st.lists(st.floats(allow_nan=False), max_size=3),
    st.lists(TEXTS, max_size=3),
    st.binary(max_size=5),
)


def parameters(values: st.SearchStrategy[object]) -> st.SearchStrategy[list[Parameter]]:
    return st.lists(st.builds(Parameter, TEXTS, values.map(parameter_value)), max_size=4)


def generated(wanted: list[Parameter]) -> bytes:
    return srv.SetParameters_Request(parameters=[to_message(item) for item in wanted]).encode()


def test_one_double_as_protocol_md_lays_it_out() -> None:
    wanted = [Parameter("speed", parameter_value(0.5))]
    expected = bytes.fromhex(
        "00010000"  # XCDR1, little endian
        "01000000"  # one parameter
        "06000000 737065656400"  # its name
        "03 00"  # DOUBLE; the bool
        "0000000000000000"  # the integer, at 16
        "000000000000e03f"  # the double
        "01000000 00 000000"  # an empty string, padding
        "00000000 00000000 00000000 00000000 00000000"  # five empty arrays
    )
    assert simple_request(wanted) == expected == generated(wanted)
    assert parse_simple_request(expected) == wanted


@given(parameters(SIMPLE))
def test_single_values_take_the_short_way_both_ways(wanted: list[Parameter]) -> None:
    data = simple_request(wanted)
    assert data == generated(wanted)
    assert parse_simple_request(data) == wanted


@given(parameters(st.one_of(SIMPLE, ARRAYS)))
def test_the_services_carry_everything(wanted: list[Parameter]) -> None:
    for name in SETTING:
        request = set_service_type(name).request
        assert request.encode(wanted) == generated(wanted)
        assert list(request.decode(generated(wanted))) == wanted


@given(parameters(SIMPLE), st.data())
def test_spoilt_bytes_are_read_as_the_generated_classes_read_them(wanted: list[Parameter], draw: st.DataObject) -> None:
    data = bytearray(generated(wanted))
    for _ in range(draw.draw(st.integers(0, 3))):
        data[draw.draw(st.integers(0, len(data) - 1))] = draw.draw(st.integers(0, 255))
    raw = bytes(data[: draw.draw(st.integers(0, len(data)))] if draw.draw(st.booleans()) else data)
    short = parse_simple_request(raw)
    if short is None:
        return
    try:
        known = [from_message(item) for item in srv.SetParameters_Request.decode(raw).parameters]
    except DecodeError as error:
        pytest.fail(f"the generated class says {error}, the short way {short}")
    assert repr(short) == repr(known)  # NaN is not equal to itself


def test_what_cannot_be_sent_has_the_words_of_the_generated_classes() -> None:
    request = set_service_type("SetParameters").request
    for wrong in (
        Parameter("a", ParameterValue(ParameterType.INTEGER, 2**63)),
        Parameter("\ud800", parameter_value(1)),
    ):
        assert simple_request([wrong]) is None
        with pytest.raises(EncodeError):
            request.encode([wrong])


@pytest.mark.parametrize("results", [[SetResult(True)], [SetResult(False, "no")], [SetResult(True, "but")]])
def test_answers_are_those_of_the_generated_classes(results: list[SetResult]) -> None:
    each, whole = (set_service_type(name).response for name in SETTING)
    messages = [result_to_message(item) for item in results]
    assert each.encode(results) == srv.SetParameters_Response(results=messages).encode()
    assert whole.encode(results) == srv.SetParametersAtomically_Response(result=messages[0]).encode()
    for kind in (each, whole):
        assert list(kind.decode(kind.encode(results))) == results
        padded = bytearray(kind.encode(results)) + bytes(3)
        padded[3] = 3  # as DDS hands it over
        assert list(kind.decode(bytes(padded))) == results
    several = [*results, SetResult(True)]
    assert list(each.decode(each.encode(several))) == several
    assert list(each.decode(each.encode([]))) == []
