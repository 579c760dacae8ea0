"""Lifecycle nodes of rclpy controlled by this package, and lifecycle nodes of this package controlled by rclpy."""

from __future__ import annotations

import asyncio
from typing import Any

from peer_helpers import fresh, message, plain, service
from rclpy_peer import Peer

from rosidl_py_gen import from_dict
from rosidl_py_gen.runtime import LifecycleNode, Node, State, TransitionCallbackReturn

WAIT_S = 10
CHANGE, GET = "lifecycle_msgs/srv/ChangeState", "lifecycle_msgs/srv/GetState"
EVENT = "lifecycle_msgs/msg/TransitionEvent"
STEPS = [
    *((1, True, "inactive"), (3, True, "active"), (1, False, "active")),
    *((4, True, "inactive"), (5, False, "inactive"), (6, True, "finalized")),
]
"""Transition, success, resulting state."""
EVENTS = [
    ("unconfigured", "configuring"),
    ("configuring", "inactive"),
    ("inactive", "activating"),
    ("activating", "active"),
]


async def call(node: Node, peer: Peer, kind: str, name: str, request: dict[str, Any]) -> Any:
    cls = service(peer, kind)
    client = node.create_client(cls, name)
    response = await client.call(from_dict(cls.Request, request), WAIT_S)
    client.close()
    return plain(response)


async def test_lifecycle_services_change_states_of_rclpy_node(world: Any, shared_peer: Peer) -> None:
    node, name = world.node("tester"), fresh("managed")
    await shared_peer.do("lifecycle_node", name=name.strip("/"))
    events = node.create_subscription(message(shared_peer, EVENT), f"{name}/transition_event")
    assert await events.wait_for_publishers(timeout_s=WAIT_S)
    while not (await shared_peer.do("counts", topic=events.topic))[1]:  # it has to know us, too
        await asyncio.sleep(0.02)
    for transition, works, state in STEPS:
        if not works and shared_peer.distro in ("humble", "jazzy"):
            continue  # their rclpy ends with an error
        answer = await call(node, shared_peer, CHANGE, f"{name}/change_state", {"transition": {"id": transition}})
        assert answer == {"success": works}, transition
        found = await call(node, shared_peer, GET, f"{name}/get_state", {})
        assert found["current_state"]["label"] == state
    seen = [await events.receive(timeout_s=WAIT_S) for _ in EVENTS]
    assert [(one.start_state.label, one.goal_state.label) for one in seen] == EVENTS
    assert await shared_peer.do("transitions", name=name.strip("/")) == ["configure", "activate", "shutdown"]


class Managed(LifecycleNode):
    done: list[str]

    def on_configure(self, state: State) -> TransitionCallbackReturn:
        self.done = ["configure"]
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        self.done.append("activate")
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: State) -> TransitionCallbackReturn:
        self.done.append("shutdown")
        return TransitionCallbackReturn.SUCCESS


async def test_rclpy_client_changes_states_of_lifecycle_node(world: Any, shared_peer: Peer) -> None:
    name = fresh("managed")
    node = Managed(name.strip("/"), context=world.context())
    try:
        await shared_peer.do("subscribe", topic=f"{name}/transition_event", type=EVENT)
        await shared_peer.do("matched", topic=f"{name}/transition_event")
        while not node.count_subscribers(f"{name}/transition_event"):  # it has to know them, too
            await asyncio.sleep(0.02)
        await shared_peer.do("client", name=f"{name}/change_state", type=CHANGE)
        await shared_peer.do("client", name=f"{name}/get_state", type=GET)
        for transition, works, state in STEPS:
            request = {"transition": {"id": transition}}
            answer = await shared_peer.do("call", name=f"{name}/change_state", requests_=[request])
            assert answer == [{"success": works}], transition
            (found,) = await shared_peer.do("call", name=f"{name}/get_state", requests_=[{}])
            assert found["current_state"]["label"] == state
        seen = await shared_peer.do("take", topic=f"{name}/transition_event", count=len(EVENTS))
        assert [(one["start_state"]["label"], one["goal_state"]["label"]) for one in seen] == EVENTS
        assert node.done == ["configure", "activate", "shutdown"]
    finally:
        node.close()
