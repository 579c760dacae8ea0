"""``param set`` and ``param delete``.

A value is read as in a parameter file. If the node rejects it, it is converted to the type of the parameter and sent
again: `3.0` to an integer, `"NaN"` to a double, `[1, 2.5]` to doubles, `5` to a string.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import CommandError, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import ParameterClient, ParameterType, ParameterValue, SetResult


async def _set_or_delete(
    network: options.NetworkOptions, node: str, name: str, value: str | None, timeout_s: float, as_json: bool
) -> int:
    from rosidl_py_gen.ros_cli.param.parameter_access import parameters_of

    async with parameters_of(network, node, timeout_s) as client:
        result = await _set(client, name, value, timeout_s)
    reason = f": {result.reason}" if result.reason else ""
    if as_json:
        terminal_output.document({"successful": result.successful, "reason": result.reason})
    elif not result.successful:
        raise CommandError(f"{'Deleting' if value is None else 'Setting'} parameter failed{reason}")
    else:
        success = "Deleted parameter successfully" if value is None else "Set parameter successful"
        terminal_output.line(f"{success}{reason}")
    return 0 if result.successful else 1


@click.command("set", context_settings={"ignore_unknown_options": True})
@options.node_argument()
@options.parameter_argument()
@click.argument("value")
@options.node_timeout
@options.as_json
@options.node_options
@verb
def set_(**arguments: Any) -> Any:
    """Set a parameter.

    VALUE is read as in a parameter file: 1 is an integer, 1.0 a double, on is true, '"1"' a string.

    \b
    rosidl-py param set /talker rate 2.5
    rosidl-py param set /talker names '[left, right]'
    """
    return _set_or_delete(**arguments)


@click.command("delete")
@options.node_argument()
@options.parameter_argument()
@options.node_timeout
@options.as_json
@options.node_options
@verb
def delete(**arguments: Any) -> Any:
    """Delete a parameter, if the node allows it.

    \b
    rosidl-py param delete /talker label
    """
    return _set_or_delete(value=None, **arguments)


async def _set(client: ParameterClient, name: str, text: str | None, timeout_s: float) -> SetResult:
    from rosidl_py_gen.runtime import (
        Parameter,
        ParameterFileError,
        ParameterNotDeclaredError,
        ParameterValue,
        parse_parameter_value,
    )

    requested, file_error, result = ParameterValue(), None, None
    try:
        requested = ParameterValue() if text is None else parse_parameter_value(text)
        (result,) = await client.set([Parameter(name, requested)], timeout_s)
        if result.successful or text is None:
            return result
    except ParameterFileError as error:
        file_error = error
    assert text is not None
    try:
        fitted = fit_parameter(text, await client.get_types(name, timeout_s))
    except (CommandError, ParameterNotDeclaredError):
        fitted = None
    if fitted is None or fitted == requested:
        if result is None:
            raise file_error or AssertionError
        return result
    (result,) = await client.set([Parameter(name, fitted)], timeout_s)
    return result


def fit_parameter(text: str, kind: ParameterType) -> ParameterValue | None:
    """Return a text as a parameter value of a type; None if it cannot be converted."""
    from rosidl_py_gen.ros_cli.values import as_bool, as_float, as_integer, as_text, parse_value
    from rosidl_py_gen.runtime import InvalidParameterValueError, ParameterType, parameter_value

    convert = {
        ParameterType.BOOL: as_bool,
        ParameterType.INTEGER: as_integer,
        ParameterType.DOUBLE: lambda value: float(value) if type(value) is int else as_float(value),
        ParameterType.STRING: as_text,
    }
    parsed = parse_value(text)
    scalar = ParameterType[kind.name.removesuffix("_ARRAY")] if kind.is_array and kind.name != "BYTE_ARRAY" else kind
    if scalar not in convert or isinstance(parsed, list) is not kind.is_array:
        return None
    try:
        value = [convert[scalar](item) for item in parsed] if kind.is_array else convert[scalar](parsed)
        return parameter_value(value, kind)
    except (InvalidParameterValueError, OverflowError):
        return None
