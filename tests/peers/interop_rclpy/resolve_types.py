"""A node of ours without definitions of the peer's packages, which prints one result as JSON.

It is a process of its own, because a class that a test has compiled is available to all tests of a process.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from rosidl_py_gen import RosidlError, from_dict, to_json
from rosidl_py_gen.cdr.type_queries import constants, referenced_classes
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.runtime import Node

WAIT_S = 15


async def echo(node: Node, topic: str) -> dict[str, Any]:
    """Return the first message, and the constants of all types in it."""
    cls = await node.resolve_type(topic, timeout_s=WAIT_S)
    message = await node.create_subscription(cls, topic).receive(WAIT_S)
    found = {name: constants(one) for name, one in referenced_classes(cls).items()}
    return {"message": json.loads(to_json(message)), "constants": found}


async def call(node: Node, service: str, request: dict[str, Any], type_hash: str | None) -> Any:
    cls: Any = await node.resolve_service_type(service, type_hash=type_hash, timeout_s=WAIT_S)
    response = await node.create_client(cls, service).call(from_dict(cls.Request, request), WAIT_S)
    return json.loads(to_json(response))


async def send(node: Node, action: str, goal: dict[str, Any], type_hash: str | None) -> Any:
    cls: Any = await node.resolve_action_type(action, type_hash=type_hash, timeout_s=WAIT_S)
    client = node.create_action_client(cls, action)
    assert await client.wait_for_server(WAIT_S)
    sent = await client.send_goal(from_dict(cls.Goal, goal), timeout_s=WAIT_S)
    _, result = await sent.result(timeout_s=WAIT_S)
    return json.loads(to_json(result))


async def main(do: str, **arguments: Any) -> None:
    async with Node("resolver") as node:
        try:
            answer = {"result": await globals()[do](node, **arguments)}
        except (RosidlError, TypeNotFoundError) as error:
            answer = {"error": str(error)}
    print(json.dumps(answer))


asyncio.run(main(sys.argv[1], **json.loads(sys.argv[2])))
