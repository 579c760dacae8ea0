"""Commands of ``rosidl-py param``: list, get, set, describe, dump, load and delete.

``list`` sends requests to all nodes at once, so a node that does not reply delays no other. ``set`` reads a value as in
a parameter file. If the node rejects the value, the value is converted to the type of the parameter and sent again:
`3.0` to an integer, `"NaN"` to a double, `[1, 2.5]` to doubles, `5` to a string.
"""

from __future__ import annotations

from contextlib import asynccontextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.terminal_text import printable_line
from rosidl_py_gen.command_support import CommandError, report, terminal_output
from rosidl_py_gen.ros_cli import options

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Sequence

    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import ParameterClient, ParameterDescriptor, ParameterType, ParameterValue, SetResult


@asynccontextmanager
async def _parameters_of(command_node: CommandNode, node: str, timeout_s: float) -> AsyncIterator[ParameterClient]:
    """Yield a client for the parameters of a node; failed requests are raised as `CommandError`.

    The existence of node and parameters is checked only after a request has failed.
    """
    from rosidl_py_gen.runtime import CallTimeoutError, ParameterNotDeclaredError, ServerLostError, WaitTimeoutError

    client = command_node.node.create_parameter_client(node if node.startswith("/") else f"/{node}")
    try:
        await client.wait_for_services(timeout_s)
    except WaitTimeoutError:
        await command_node.find("node", node, 0)
        text = f"node {client.node} exists, but offered no parameter services in {timeout_s:g} s"
        raise CommandError(text) from None
    try:
        yield client
    except (CallTimeoutError, ServerLostError) as error:
        raise CommandError(f"node {client.node}: {error}") from None
    except ParameterNotDeclaredError as error:
        raise CommandError(await _missing_parameters_text(client, error.names, timeout_s)) from None


async def _missing_parameters_text(client: ParameterClient, requested: Sequence[str], timeout_s: float) -> str:
    known = (await client.list(timeout_s=timeout_s)).names
    unknown = [name for name in requested if name not in known]
    if not unknown:
        return f"{client.node} has {', '.join(requested)}, but at least one of them has no value"
    return f"{client.node} has no parameter {', '.join(unknown)}{did_you_mean(unknown[0], known)}"


def _type_text(kind: ParameterType) -> str:
    """Return the name that ``ros2 param`` prints for a parameter type, such as ``boolean array``."""
    return kind.name.lower().replace("_", " ").replace("bool", "boolean")


def _plain(value: Any) -> Any:
    """Return the value of a parameter in the form for output, in which tuples and bytes become lists."""
    return list(value) if isinstance(value, tuple | bytes) else value


@click.command("list")
@options.node_argument(required=False)
@click.option("--filter", "pattern", metavar="REGEX", help="Only parameters with a name whose beginning matches REGEX.")
@click.option(
    "--param-prefixes",
    "prefixes",
    multiple=True,
    metavar="PREFIX",
    help="Only parameters below PREFIX. May be repeated.",
)
@click.option("--param-type", "show_types", is_flag=True, help="Show the types.")
@click.option("-a", "--include-hidden-nodes", "hidden", is_flag=True, help="Include hidden nodes.")
@options.node_timeout
@options.as_json
@options.node_verb
async def list_(
    command_node: CommandNode,
    node: str | None,
    pattern: str | None,
    prefixes: tuple[str, ...],
    show_types: bool,
    hidden: bool,
    timeout_s: float,
    as_json: bool,
) -> int:
    """Print the parameters of a node, or of all nodes.

    \b
    rosidl-py param list
    rosidl-py param list /talker --param-type
    rosidl-py param list --filter '.*rate'
    """
    from rosidl_py_gen.ros_cli.graph_verbs import results_by_name

    regex = options.compile_pattern(pattern or "", "--filter")

    async def names_and_types(client: ParameterClient) -> dict[str, str]:
        """Return the sorted names of a node's parameters with their types; types are "" unless they are printed."""
        listing = await client.list(prefixes, timeout_s=timeout_s)
        names = [name for name in sorted(listing.names) if regex.match(name)]
        if not show_types or not names:
            return dict.fromkeys(names, "")
        described = await client.describe(names, timeout_s)
        return {name: _type_text(one.type) for name, one in zip(names, described, strict=True)}

    if node:
        async with _parameters_of(command_node, node, timeout_s) as client:
            _print_lists({client.node: await names_and_types(client)}, as_json, headings=False)
        return 0
    await command_node.wait_for_discovery()
    nodes = command_node.nodes_with_parameters(hidden=hidden)
    command_node.note_if_alone()
    create = command_node.node.create_parameter_client
    parameters = await results_by_name({name: names_and_types(create(name)) for name in nodes})
    _print_lists(parameters, as_json, headings=True)
    return 1 if nodes and not parameters else 0


def _print_lists(parameters: dict[str, dict[str, str]], as_json: bool, *, headings: bool) -> None:
    if as_json:
        terminal_output.document(
            {
                node: [{"name": name, **({"type": kind} if kind else {})} for name, kind in names.items()]
                for node, names in parameters.items()
            }
        )
        return
    for node, names in parameters.items():
        if headings and names:
            terminal_output.line(f"{node}:", "bold cyan")
        terminal_output.lines(f"  {name} (type: {kind})" if kind else f"  {name}" for name, kind in names.items())


@click.command("get")
@options.node_argument()
@options.parameter_argument()
@click.option("--hide-type", is_flag=True, help="Print only the value.")
@options.node_timeout
@options.as_json
@options.node_verb
async def get(
    command_node: CommandNode, node: str, name: str, hide_type: bool, timeout_s: float, as_json: bool
) -> None:
    """Print the value of a parameter.

    \b
    rosidl-py param get /talker use_sim_time
    rosidl-py param get /talker rate --hide-type
    """
    from rosidl_py_gen.runtime import parameter_value

    async with _parameters_of(command_node, node, timeout_s) as client:
        value = await client.get(name, timeout_s)
        # The type of an empty list is unknown here.
        kind = await client.get_types(name, timeout_s) if value == () else parameter_value(value).type
    plain = _plain(value)
    if as_json:
        terminal_output.document(plain)
    elif hide_type:
        terminal_output.block(str(plain))
    elif value is None:
        terminal_output.line("Parameter not set.")
    else:
        word = kind.name.removesuffix("_ARRAY").capitalize().replace("Bool", "Boolean")
        terminal_output.block(f"{word} {'values are' if kind.is_array else 'value is'}: {plain}")


@click.command("describe")
@options.node_argument()
@options.parameter_argument("names", nargs=-1, required=True, metavar="NAME...")
@options.node_timeout
@options.as_json
@options.node_verb
async def describe(
    command_node: CommandNode, node: str, names: tuple[str, ...], timeout_s: float, as_json: bool
) -> None:
    """Print type, description and limits of parameters.

    \b
    rosidl-py param describe /talker rate use_sim_time
    """
    async with _parameters_of(command_node, node, timeout_s) as client:
        descriptors = await client.describe(names, timeout_s)
    lines = [line for one in descriptors for line in _description(one)]
    terminal_output.result(lines, as_json, [{**asdict(one), "type": _type_text(one.type)} for one in descriptors])


def _description(descriptor: ParameterDescriptor) -> list[str]:
    lines = [f"Parameter name: {descriptor.name}", f"  Type: {_type_text(descriptor.type)}"]
    if descriptor.description:
        lines.append(f"  Description: {descriptor.description}")
    lines.append("  Constraints:")
    if descriptor.read_only:
        lines.append("    Read only: true")
    if limits := descriptor.floating_point_range or descriptor.integer_range:
        lines += [f"    Min value: {limits.from_value}", f"    Max value: {limits.to_value}"]
        if limits.step:
            lines.append(f"    Step: {limits.step}")
    if descriptor.additional_constraints:
        lines.append(f"    Additional constraints: {descriptor.additional_constraints}")
    return lines


@click.command("dump")
@options.node_argument()
@click.option("-o", "--output", type=click.Path(dir_okay=False, writable=True), metavar="FILE", help="Write to a file.")
@options.node_timeout
@options.as_json
@options.node_verb
async def dump(command_node: CommandNode, node: str, output: str | None, timeout_s: float, as_json: bool) -> None:
    """Print all parameters of a node as a parameter file.

    \b
    rosidl-py param dump /talker -o talker.yaml
    """
    import asyncio

    end_s = command_node.now_s() + timeout_s
    async with _parameters_of(command_node, node, timeout_s) as client:
        values = await client.get_all(max(0.0, end_s - command_node.now_s())) if as_json else {}
        text = "" if as_json and output is None else await client.dump_yaml(max(0.0, end_s - command_node.now_s()))
    if output is not None:
        await asyncio.to_thread(Path(output).write_text, text, encoding="utf-8")
        terminal_output.note(f"wrote {output}")
    if as_json:
        terminal_output.document({client.node: {name: _plain(value) for name, value in values.items()}})
    elif output is None:
        terminal_output.block(text.rstrip("\n"))


@click.command("load")
@options.node_argument()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, readable=True))
@options.node_timeout
@options.as_json
@options.node_verb
async def load(command_node: CommandNode, node: str, file: str, timeout_s: float, as_json: bool) -> int:
    """Set the parameters of a node that a parameter file contains.

    \b
    rosidl-py param load /talker talker.yaml
    """
    async with _parameters_of(command_node, node, timeout_s) as client:
        results = await client.load_yaml(file, timeout_s)
    if as_json:
        terminal_output.document({name: asdict(result) for name, result in results.items()})
    for name, result in () if as_json else results.items():
        reason = f": {result.reason}" if result.reason else ""
        if result.successful:
            terminal_output.line(f"Set parameter {name} successful{reason}")
        else:
            report(printable_line(f"Set parameter {name} failed{reason}"))
    return 0 if all(result.successful for result in results.values()) else 1


@click.command("set", context_settings={"ignore_unknown_options": True})
@options.node_argument()
@options.parameter_argument()
@click.argument("value")
@options.node_timeout
@options.as_json
@options.node_verb
async def set_(**arguments: Any) -> int:
    """Set a parameter.

    VALUE is read as in a parameter file: 1 is an integer, 1.0 a double, on is true, '"1"' a string.

    \b
    rosidl-py param set /talker rate 2.5
    rosidl-py param set /talker names '[left, right]'
    """
    return await _set_or_delete(**arguments)


@click.command("delete")
@options.node_argument()
@options.parameter_argument()
@options.node_timeout
@options.as_json
@options.node_verb
async def delete(**arguments: Any) -> int:
    """Delete a parameter, if the node allows it.

    \b
    rosidl-py param delete /talker label
    """
    return await _set_or_delete(value=None, **arguments)


async def _set_or_delete(
    command_node: CommandNode, node: str, name: str, value: str | None, timeout_s: float, as_json: bool
) -> int:
    async with _parameters_of(command_node, node, timeout_s) as client:
        result = await _set(client, name, value, timeout_s)
    reason = f": {result.reason}" if result.reason else ""
    if not (result.successful or as_json):
        raise CommandError(f"{'Deleting' if value is None else 'Setting'} parameter failed{reason}")
    success = "Deleted parameter successfully" if value is None else "Set parameter successful"
    terminal_output.result([f"{success}{reason}"], as_json, asdict(result))
    return 0 if result.successful else 1


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
    """Convert a text to a parameter value of the type `kind`; None if the text does not fit the type."""
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
