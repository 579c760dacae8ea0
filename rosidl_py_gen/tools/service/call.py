"""``service call``.

Decides that requests and responses are shown as rclpy's own `repr` shows them, as with ``ros2 service call``.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import to_dict
from rosidl_py_gen.tools import Job, messages, printing, types
from rosidl_py_gen.tools.commands.service import CallOptions
from rosidl_py_gen.tools.service.info import find_service
from rosidl_py_gen.tools.session import Network, Session

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import Client


def run(network: Network, options: CallOptions) -> Job:
    """What the command does."""
    return Job(_call(network, options), endless=options.rate is not None)


async def _call(network: Network, options: CallOptions) -> int:
    type_name, text = messages.type_and_values(options.words, stdin=options.stdin)
    async with Session(network) as session:
        name = await types.meanwhile(find_service(session, options.service, options.timeout_s))
        cls: Any = await types.service_class(session, name, type_name, options.paths)
        request = messages.message_from(cls.Request, text)
        client = session.node.create_client(cls, name)
        loop = asyncio.get_running_loop()
        while True:
            began = loop.time()
            await _one_call(client, request, options)
            if options.rate is None:
                return 0
            await asyncio.sleep(began + 1 / options.rate - loop.time())


async def _one_call(client: Client[Any, Any], request: Message, options: CallOptions) -> None:
    truncate = None if options.full_length else messages.TRUNCATE
    if not options.as_json:
        printing.lines([f"requester: making request: {messages.shown(request, truncate)}", ""])
    response = await client.call(request, options.timeout_s)
    if options.as_json:
        (printing.document if options.rate is None else printing.json_line)(to_dict(response))
    else:
        printing.lines(["response:", messages.shown(response, truncate), ""])
