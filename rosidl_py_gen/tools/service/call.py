"""``service call``.

Decides that requests and responses are shown as rclpy's own `repr` shows them, as with ``ros2 service call``.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import to_dict
from rosidl_py_gen.tools import Job, messages, printing, types
from rosidl_py_gen.tools.service.info import find_service
from rosidl_py_gen.tools.session import Network, Session

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import Client


def run(network: Network, rate: float | None, **arguments: Any) -> Job:
    """What the command does."""
    return Job(_call(network, rate, **arguments), endless=rate is not None)


async def _call(
    network: Network,
    rate: float | None,
    service: str,
    words: tuple[str, ...],
    stdin: bool,
    full_length: bool,
    timeout_s: float,
    paths: tuple[str, ...],
    as_json: bool,
) -> int:
    type_name, text = messages.type_and_values(words, stdin=stdin)
    async with Session(network) as session:
        name = await types.meanwhile(find_service(session, service, timeout_s))
        cls: Any = await types.service_class(session, name, type_name, paths)
        request = messages.message_from(cls.Request, text)
        client = session.node.create_client(cls, name)
        truncate = None if full_length else messages.TRUNCATE
        loop = asyncio.get_running_loop()
        while True:
            began = loop.time()
            await _one_call(client, request, timeout_s, truncate, as_json, in_stream=rate is not None)
            if rate is None:
                return 0
            await asyncio.sleep(began + 1 / rate - loop.time())


async def _one_call(
    client: Client[Any, Any],
    request: Message,
    timeout_s: float,
    truncate: int | None,
    as_json: bool,
    *,
    in_stream: bool,
) -> None:
    if not as_json:
        printing.line(f"requester: making request: {messages.shown(request, truncate)}\n")
    response = await client.call(request, timeout_s)
    if as_json:
        (printing.json_line if in_stream else printing.document)(to_dict(response))
    else:
        printing.line(f"response:\n{messages.shown(response, truncate)}\n")
