"""Actions in the format of Humble, with a peer that is spoken by hand, as server and as client."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

import pytest
import zenoh
from example_interfaces.action import Fibonacci
from support.node_fixtures import until
from support.zenoh_peer import PlainPublisher, attachment

from rosidl_py_gen.runtime import GoalStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from support.node_fixtures import World
    from support.zenoh_peer import Peer

    from rosidl_py_gen.runtime import ServerGoal

CDR, SUCCEEDED = b"\0\1\0\0", 4
GOAL_ID = bytes(range(16))


def of(name: str) -> str:
    """A type as Humble has it in keys and tokens."""
    package, _, name = name.rpartition("/")
    return f"{package.replace('/', '::')}::dds_::{name}_/TypeHashNotSupported"


SEND_GOAL = of("example_interfaces/action/Fibonacci_SendGoal")
GET_RESULT = of("example_interfaces/action/Fibonacci_GetResult")
FEEDBACK = of("example_interfaces/action/Fibonacci_FeedbackMessage")
CANCEL, STATUS = of("action_msgs/srv/CancelGoal"), of("action_msgs/msg/GoalStatusArray")


def sequence(*numbers: int) -> bytes:
    return struct.pack(f"<I{len(numbers)}i", len(numbers), *numbers)


@pytest.fixture(autouse=True)
def _humble(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROSIDL_PY_GEN_ZENOH_FORMAT", "humble")


def serve(peer: Peer, name: str, type_and_hash: str, respond: Callable[[bytes], bytes]) -> None:
    """A service of the peer, from request to response without the CDR header."""

    def answer(query: Any) -> None:
        body = respond(query.payload.to_bytes()[4:])
        query.reply(str(query.key_expr), CDR + body, attachment=query.attachment.to_bytes())
        query.drop()

    peer.serve(peer.key(name, type_and_hash), answer)
    peer.tell("SS", name, type_and_hash)


def call(peer: Peer, name: str, type_and_hash: str, request: bytes) -> list[bytes]:
    """Call a service; what it responds is added to the list."""
    responses: list[bytes] = []
    querier = peer.session.declare_querier(
        peer.key(name, type_and_hash),
        target=zenoh.QueryTarget.ALL_COMPLETE,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=20.0,
    )
    peer.keep(querier)
    take = zenoh.handlers.Callback(lambda reply: responses.append(reply.ok.payload.to_bytes()[4:]), indirect=False)
    querier.get(take, payload=CDR + request, attachment=attachment(1, peer.tell("SC", name, type_and_hash)))
    return responses


async def test_a_goal_for_a_server_of_humble(zenoh: World, peer: Peer) -> None:
    feedback = PlainPublisher(peer, "/count/_action/feedback", FEEDBACK)
    PlainPublisher(peer, "/count/_action/status", STATUS)
    cancelled: list[bytes] = []

    def take_goal(request: bytes) -> bytes:
        goal_id, order = request[:16], *struct.unpack("<i", request[16:])
        feedback.publish(CDR + goal_id + sequence(order))
        return struct.pack("<?3xiI", True, 1, 2)

    def cancel(request: bytes) -> bytes:
        cancelled.append(request[:16])
        return struct.pack("<b3xI16siI", 0, 1, request[:16], 1, 2)

    serve(peer, "/count/_action/send_goal", SEND_GOAL, take_goal)
    serve(peer, "/count/_action/get_result", GET_RESULT, lambda _: struct.pack("<b3x", SUCCEEDED) + sequence(0, 1, 1))
    serve(peer, "/count/_action/cancel_goal", CANCEL, cancel)

    client = zenoh.node("ours").create_action_client(Fibonacci, "/count")
    assert await client.wait_for_server(5)
    goal = await client.send_goal(Fibonacci.Goal(order=7), timeout_s=5)
    heard = [list(one.sequence) async for one in goal.feedback()]
    status, result = await goal.result(5)
    assert (heard, status, list(result.sequence)) == ([[7]], GoalStatus.SUCCEEDED, [0, 1, 1])
    other = await client.send_goal(Fibonacci.Goal(order=8), timeout_s=5)
    await other.cancel(5)
    assert cancelled == [other.goal_id]


async def test_a_goal_of_a_client_of_humble(zenoh: World, peer: Peer) -> None:
    async def execute(goal: ServerGoal[Any]) -> Fibonacci.Result:
        goal.publish_feedback(Fibonacci.Feedback(sequence=[goal.request.order]))
        return Fibonacci.Result(sequence=[2, 3, 5])

    zenoh.node("ours").create_action_server(Fibonacci, "/primes", execute)
    feedback, statuses = list[bytes](), list[bytes]()
    for name, kind, heard in (("feedback", FEEDBACK, feedback), ("status", STATUS, statuses)):
        peer.listen(peer.key(f"/primes/_action/{name}", kind), heard)
        peer.tell("MS", f"/primes/_action/{name}", kind)
    await until(lambda: bool(peer.of_others("SS", "/primes/_action/get_result")))

    accepted = call(peer, "/primes/_action/send_goal", SEND_GOAL, GOAL_ID + struct.pack("<i", 3))
    await until(lambda: len(accepted) == 1)
    assert accepted[0][0] == 1
    results = call(peer, "/primes/_action/get_result", GET_RESULT, GOAL_ID)
    await until(lambda: len(results) == 1 and bool(statuses) and statuses[-1][4 + 28] == SUCCEEDED)
    assert results == [struct.pack("<b3x", SUCCEEDED) + sequence(2, 3, 5)]
    await until(lambda: feedback == [CDR + GOAL_ID + sequence(3)])
    # how many goals, then of each id, time and status
    assert statuses[-1][4:24] == struct.pack("<I", 1) + GOAL_ID
