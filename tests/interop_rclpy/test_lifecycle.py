"""Our lifecycle nodes, driven by rclpy."""

from __future__ import annotations

import asyncio
from typing import Any

from peer_helpers import fresh
from rclpy_peer import Peer

from rosidl_py_gen.runtime import LifecycleNode, State, TransitionCallbackReturn

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


async def test_they_drive_our_lifecycle_node(dds: Any, shared_peer: Peer) -> None:
    name = fresh("managed")
    node = Managed(name.strip("/"), context=dds.context())
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
