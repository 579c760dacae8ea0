"""``service call``: messages are printed as by rclpy's `repr`, as in ``ros2 service call``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import AsyncCommand, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import Client


@click.command("call")
@options.service_argument()
@click.argument("words", nargs=-1, metavar="[TYPE] [VALUES]", shell_complete=options.call_completion("service"))
@click.option("--stdin", is_flag=True, help="Read the values from standard input.")
@options.rate("-r", "--rate", help="Calls per second; repeat until Ctrl-C.")
@click.option("-f", "--full-length", is_flag=True, help="Print long arrays and strings in full.")
@options.timeout("Maximum time to wait for the server, and for each response.", default_s=10)
@options.paths
@options.as_json
@options.node_options
@verb
def call(
    network: options.NetworkOptions,
    service: str,
    words: tuple[str, ...],
    stdin: bool,
    rate: float | None,
    full_length: bool,
    timeout_s: float,
    paths: tuple[str, ...],
    as_json: bool,
) -> AsyncCommand:
    """Call a service. VALUES are YAML or JSON; omitted fields have their defaults.

    TYPE may be omitted. --json prints only the response.

    \b
    rosidl-py service call /add_two_ints '{a: 1, b: 2}'
    rosidl-py service call /add_two_ints example_interfaces/srv/AddTwoInts '{a: 1, b: 2}'
    rosidl-py service call /status std_srvs/srv/Trigger --rate 2 --json
    """
    import asyncio

    from rosidl_py_gen import to_dict
    from rosidl_py_gen.ros_cli import message_text, type_resolution
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.service.info import find_service

    async def main() -> int:
        type_name, text = message_text.type_and_values(words, stdin=stdin)
        async with CommandNode(network) as command_node:
            name = await type_resolution.preload_while_waiting(find_service(command_node, service, timeout_s))
            cls: Any = await type_resolution.service_class(command_node, name, type_name, paths)
            request = message_text.message_from(cls.Request, text)
            client = command_node.node.create_client(cls, name)
            loop = asyncio.get_running_loop()
            while True:
                start_s = loop.time()
                await one_call(client, request)
                if rate is None:
                    return 0
                await asyncio.sleep(start_s + 1 / rate - loop.time())

    async def one_call(client: Client[Any, Any], request: Message) -> None:
        truncate = None if full_length else message_text.TRUNCATE
        if not as_json:
            terminal_output.lines([f"requester: making request: {message_text.rclpy_repr(request, truncate)}", ""])
        response = await client.call(request, timeout_s)
        if as_json:
            terminal_output.document(to_dict(response), in_stream=rate is not None)
        else:
            terminal_output.lines(["response:", message_text.rclpy_repr(response, truncate), ""])

    return AsyncCommand(main(), endless=rate is not None)
