"""Parameters: rclpy's own client and our node, our client and rclpy's node."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from peer_helpers import fresh, repeated
from rclpy_peer import Peer
from support.waiting import until

from rosidl_py_gen.runtime import Node, ParameterDescriptor, ParameterNotDeclaredError, ParameterType

WAIT_S = 10
VALUES: dict[str, Any] = {
    "flag": True,
    "count": -(2**62),
    "gain": 0.1,
    "label": "grüße",
    "flags": [True, False],
    "counts": [1, -2, 3],
    "gains": [1.5, -0.5],
    "arm.left.labels": ["a", "", "ü"],
}
TYPES = [ParameterType[name] for name in ("BOOL", "INTEGER", "DOUBLE", "STRING")]
TYPES += [ParameterType[f"{one.name}_ARRAY"] for one in TYPES]
NEW: dict[str, Any] = {"flag": False, "count": 7, "label": "new", "counts": [9]}
RCLPY_QOS = {"depth": 1000}
FILE = "{}:\n  ros__parameters:\n    count: 11\n    arm:\n      left:\n        labels: [ab, cd]\n"


def as_lists(values: Any) -> list[Any]:
    return [list(value) if isinstance(value, tuple) else value for value in values]


def member(answer: dict[str, Any]) -> Any:
    """Return the value inside a rcl_interfaces/msg/ParameterValue."""
    names = "bool_value integer_value double_value string_value byte_array_value bool_array_value"
    names += " integer_array_value double_array_value string_array_value"
    return answer[names.split()[answer["type"] - 1]]


def node_with_all_types(world: Any) -> Node:
    node: Node = world.node(fresh("own_node").strip("/"))
    for name, value in VALUES.items():
        node.declare_parameter(name, value)
    return node


async def call_by_rclpy(peer: Peer, node: Node, method: str, argument: Any) -> Any:
    """Return the response that rclpy's AsyncParameterClient gets from our node."""
    return await peer.do("remote", node=node.fully_qualified_name, method=method, argument=argument)


async def test_rclpy_client_reads_parameters(world: Any, shared_peer: Peer) -> None:
    own_node = node_with_all_types(world)
    names = list(VALUES)
    answer = await call_by_rclpy(shared_peer, own_node, "get_parameters", names)
    assert [member(value) for value in answer["values"]] == list(VALUES.values())
    assert (await call_by_rclpy(shared_peer, own_node, "get_parameter_types", names))["types"] == TYPES
    described = (await call_by_rclpy(shared_peer, own_node, "describe_parameters", names))["descriptors"]
    assert [(one["name"], one["type"]) for one in described] == list(zip(names, TYPES, strict=True))
    assert (await call_by_rclpy(shared_peer, own_node, "get_parameters", ["flag", "missing"]))["values"] == []
    result = (await call_by_rclpy(shared_peer, own_node, "list_parameters", None))["result"]
    assert set(VALUES) <= set(result["names"])
    result = (await call_by_rclpy(shared_peer, own_node, "list_parameters", ["arm"]))["result"]
    assert (result["names"], result["prefixes"]) == (["arm.left.labels"], ["arm.left"])


@pytest.mark.parametrize("method", ["set_parameters", "set_parameters_atomically"])
async def test_rclpy_client_sets_parameters(world: Any, shared_peer: Peer, method: str) -> None:
    own_node = node_with_all_types(world)
    answer = await call_by_rclpy(shared_peer, own_node, method, {"count": 8, "gain": "text", "missing": 1})
    if method == "set_parameters":
        assert [one["successful"] for one in answer["results"]] == [True, False, False]
        assert own_node.get_parameter("count") == 8
    else:
        assert not answer["result"]["successful"] and own_node.get_parameter("count") == VALUES["count"]
    await call_by_rclpy(shared_peer, own_node, method, NEW)
    assert as_lists(own_node.get_parameters(list(NEW))) == list(NEW.values())


async def test_integers_are_converted_for_double_parameters_in_both_directions(
    world: Any, shared_peer: Peer, remote_parameters: Any
) -> None:
    own_node = node_with_all_types(world)
    wanted = {"gain": 3, "gains": [1, 2], "count": 4}
    answer = await call_by_rclpy(shared_peer, own_node, "set_parameters", wanted)
    assert [one["successful"] for one in answer["results"]] == [True] * 3
    assert repr(as_lists(own_node.get_parameters(list(wanted)))) == "[3.0, [1.0, 2.0], 4]"
    assert [one.successful for one in await remote_parameters.set(wanted, WAIT_S)] == [True] * 3
    assert (await remote_parameters.set_atomically({"gain": 5, "count": 6}, WAIT_S)).successful
    assert repr(await values_in_rclpy(shared_peer, remote_parameters, list(wanted))) == "[5.0, [1.0, 2.0], 6]"


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_rclpy_client_loads_parameter_file(world: Any, shared_peer: Peer, tmp_path: Path) -> None:
    own_node = node_with_all_types(world)
    file = tmp_path / "parameters.yaml"
    file.write_text(FILE.format(own_node.fully_qualified_name))
    await call_by_rclpy(shared_peer, own_node, "load_parameter_file", str(file))
    assert as_lists(own_node.get_parameters(["count", "arm.left.labels"])) == [11, ["ab", "cd"]]


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_rclpy_client_undeclares_dynamic_parameter(world: Any, shared_peer: Peer) -> None:
    own_node = node_with_all_types(world)
    own_node.declare_parameter("dynamic", 1, ParameterDescriptor(dynamic_typing=True))
    answer = await call_by_rclpy(shared_peer, own_node, "delete_parameters", ["dynamic"])
    assert [one["successful"] for one in answer["results"]] == [True] and not own_node.has_parameter("dynamic")


async def test_rclpy_receives_parameter_events(world: Any, shared_peer: Peer) -> None:
    own_node = node_with_all_types(world)
    topic, name = "/parameter_events", own_node.fully_qualified_name
    await shared_peer.do("subscribe", topic=topic, type="rcl_interfaces/msg/ParameterEvent", qos=RCLPY_QOS)
    await shared_peer.do("matched", topic=topic, count=2)  # their own node is one
    await until(
        lambda: any(one.node_name == shared_peer.name for one in own_node.get_subscriptions_info_by_topic(topic))
    )

    async def from_us() -> list[Any]:
        while True:
            (event,) = await shared_peer.do("take", topic=topic)
            if event["node"] == name:
                return [(one["name"], member(one["value"])) for one in event["changed_parameters"]]

    assert await repeated(lambda: own_node.set_parameter("count", 3), from_us()) == [("count", 3)]


@pytest.fixture
def remote_parameters(world: Any, shared_peer: Peer) -> Any:
    """Return our client for the parameters of a new node of the peer with all types of values."""
    name = fresh("remote_parameters")
    shared_peer.start("add_node", name=name.strip("/")).result(WAIT_S)
    shared_peer.start("declare", node=name.strip("/"), parameters=VALUES).result(WAIT_S)
    return world.node("tester").create_parameter_client(name)


async def values_in_rclpy(peer: Peer, client: Any, names: list[str]) -> Any:
    return await peer.do("parameters", node=client.node.strip("/"), names=names)


async def test_parameter_client_reads_parameters_of_rclpy_node(remote_parameters: Any) -> None:
    names = list(VALUES)
    assert as_lists(await remote_parameters.get(names, WAIT_S)) == list(VALUES.values())
    assert await remote_parameters.get_types(names, WAIT_S) == TYPES
    assert [one.type for one in await remote_parameters.describe(names, WAIT_S)] == TYPES
    with pytest.raises(ParameterNotDeclaredError):
        await remote_parameters.get("missing", WAIT_S)
    assert set(VALUES) <= set((await remote_parameters.list(timeout_s=WAIT_S)).names)
    listing = await remote_parameters.list("arm", timeout_s=WAIT_S)
    assert list(listing.names) == ["arm.left.labels"]
    assert {"arm.left"} <= set(listing.prefixes) <= {"arm.left", "arm"}  # Humble tells what is above as well


async def test_parameter_client_sets_parameters_of_rclpy_node(remote_parameters: Any, shared_peer: Peer) -> None:
    assert not (await remote_parameters.set_atomically({"count": 8, "gain": "text"}, WAIT_S)).successful
    assert await values_in_rclpy(shared_peer, remote_parameters, ["count"]) == [VALUES["count"]]
    results = await remote_parameters.set({**NEW, "missing": 1, "gain": "text"}, WAIT_S)
    assert [one.successful for one in results] == [True] * 4 + [False] * 2
    assert await values_in_rclpy(shared_peer, remote_parameters, list(NEW)) == list(NEW.values())
    assert (await remote_parameters.set_atomically({"count": 9}, WAIT_S)).successful
    assert await values_in_rclpy(shared_peer, remote_parameters, ["count"]) == [9]


async def test_parameter_client_loads_and_dumps_file_of_rclpy_node(
    remote_parameters: Any, shared_peer: Peer, tmp_path: Path
) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(FILE.format(remote_parameters.node))
    assert all(result.successful for result in (await remote_parameters.load_yaml(file, WAIT_S)).values())
    assert await values_in_rclpy(shared_peer, remote_parameters, ["count", "arm.left.labels"]) == [11, ["ab", "cd"]]
    assert "count: 11" in await remote_parameters.dump_yaml(WAIT_S)


async def test_parameter_client_receives_events_of_rclpy_node(remote_parameters: Any) -> None:
    events = remote_parameters.events()
    assert await events.wait_for_publishers(WAIT_S)

    async def changed() -> Any:
        async for event in events:
            if event.event.changed:
                return event

    async def change() -> None:
        assert (await remote_parameters.set({"count": 3}, WAIT_S))[0].successful

    event = await repeated(change, changed())
    assert event.node == remote_parameters.node
    assert [(one.name, one.value.value) for one in event.event.changed] == [("count", 3)]
