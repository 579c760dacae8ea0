"""Types of rclpy nodes whose packages are missing in the process of this package."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import pytest
from peer_helpers import action, fresh, random_values, repeated, service, without_definitions
from rclpy_peer import Peer
from support.processes import start_process

from rosidl_py_gen import type_hash

NESTED = "test_msgs/msg/MultiNested"
BASIC = "test_msgs/srv/BasicTypes"
FIBONACCI = "test_msgs/action/Fibonacci"


@pytest.fixture
def resolver(tmp_path: Path) -> Any:
    """Return a function that runs `resolve_types.py` and returns its result, or the expected error."""

    async def run(do: str, *, is_right: bool = True, **arguments: Any) -> Any:
        script = str(Path(__file__).with_name("resolve_types.py"))
        process = await start_process(
            sys.executable,
            script,
            do,
            json.dumps(arguments),
            env=without_definitions(tmp_path),
            stdout=asyncio.subprocess.PIPE,
        )
        output, _ = await asyncio.wait_for(process.communicate(), 25)
        answer = json.loads(output)
        if is_right and "error" in answer:
            pytest.fail(answer["error"])
        return answer["result" if is_right else "error"]

    return run


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_unknown_topic_type_is_resolved_from_rclpy_publisher(shared_peer: Peer, resolver: Any) -> None:
    topic = fresh("unknown")
    (values,) = random_values(shared_peer.share, NESTED)[:1]
    await shared_peer.do("publisher", topic=topic, type=NESTED)

    async def send() -> None:
        await shared_peer.do("publish", topic=topic, messages_=[values])

    answer = await repeated(send, resolver("echo", topic=topic))
    assert answer["message"] == values
    assert answer["constants"]["test_msgs/msg/Constants"]["INT32_CONST"] == -30000  # only the source says that


@pytest.mark.only_with("lyrical")
async def test_unknown_service_type_of_lyrical_is_resolved_by_announced_hash(shared_peer: Peer, resolver: Any) -> None:
    name = fresh("unknown")
    await shared_peer.do("serve", name=name, type=BASIC, how="echo")
    request = {"int32_value": -5, "string_value": "words"}
    response = await resolver("call", service=name, request=request, type_hash=None)
    assert (response["int32_value"], response["string_value"]) == (-5, "words")


@pytest.mark.only_with("jazzy", "kilted")
async def test_unknown_service_type_requires_type_hash_or_introspection(shared_peer: Peer, resolver: Any) -> None:
    name = fresh("unknown")
    await shared_peer.do("serve", name=name, type=BASIC, how="echo")
    request = {"int32_value": -5, "string_value": "words"}
    if shared_peer.middleware != "Zenoh":  # where keys of services have the hash of the service
        error = await resolver("call", is_right=False, service=name, request=request, type_hash=None)
        assert f"/{shared_peer.name}: Type not currently in use by this node" in error and "type_hash" in error
    expected_hash = type_hash(service(shared_peer, BASIC))
    answer = await resolver("call", service=name, request=request, type_hash=expected_hash)
    assert (answer["int32_value"], answer["string_value"]) == (-5, "words")
    await shared_peer.do("introspect", kind="service", name=name, state="METADATA")
    answer = await resolver("call", service=name, request=request, type_hash=None)
    assert (answer["int32_value"], answer["string_value"]) == (-5, "words")


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_unknown_action_type_is_resolved_by_type_hash(shared_peer: Peer, resolver: Any) -> None:
    name = fresh("unknown")
    done = {"sequence": [0, 1, 1, 2]}
    await shared_peer.do("action_server", name=name, type=FIBONACCI, how="succeed", result=done)
    expected_hash = type_hash(action(shared_peer, FIBONACCI))
    assert await resolver("send", action=name, goal={"order": 4}, type_hash=expected_hash) == done
