"""Parameters: rclpy's own client and our node, our client and rclpy's node."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from peer_helpers import fresh, repeated
from rclpy_peer import Peer
from support.node_fixtures import until

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
THEIR_QOS = {"depth": 1000}
FILE = "{}:\n  ros__parameters:\n    count: 11\n    arm:\n      left:\n        labels: [ab, cd]\n"


def as_lists(values: Any) -> list[Any]:
    return [list(value) if isinstance(value, tuple) else value for value in values]


def member(answer: dict[str, Any]) -> Any:
    """Return the value inside a rcl_interfaces/msg/ParameterValue."""
    names = "bool_value integer_value double_value string_value byte_array_value bool_array_value"
    names += " integer_array_value double_array_value string_array_value"
    return answer[names.split()[answer["type"] - 1]]


def node_with_all_types(world: Any) -> Node:
    node: Node = world.node(fresh("ours").strip("/"))
    for name, value in VALUES.items():
        node.declare_parameter(name, value)
    return node


async def call_ours(peer: Peer, node: Node, method: str, argument: Any) -> Any:
    """Return the response that rclpy's AsyncParameterClient gets from our node."""
    return await peer.do("remote", node=node.fully_qualified_name, method=method, argument=argument)


async def test_their_client_reads_our_parameters(world: Any, shared_peer: Peer) -> None:
    ours = node_with_all_types(world)
    names = list(VALUES)
    answer = await call_ours(shared_peer, ours, "get_parameters", names)
    assert [member(value) for value in answer["values"]] == list(VALUES.values())
    assert (await call_ours(shared_peer, ours, "get_parameter_types", names))["types"] == TYPES
    described = (await call_ours(shared_peer, ours, "describe_parameters", names))["descriptors"]
    assert [(one["name"], one["type"]) for one in described] == list(zip(names, TYPES, strict=True))
    assert (await call_ours(shared_peer, ours, "get_parameters", ["flag", "missing"]))["values"] == []
    result = (await call_ours(shared_peer, ours, "list_parameters", None))["result"]
    assert set(VALUES) <= set(result["names"])
    result = (await call_ours(shared_peer, ours, "list_parameters", ["arm"]))["result"]
    assert (result["names"], result["prefixes"]) == (["arm.left.labels"], ["arm.left"])


@pytest.mark.parametrize("method", ["set_parameters", "set_parameters_atomically"])
async def test_their_client_sets_our_parameters(world: Any, shared_peer: Peer, method: str) -> None:
    ours = node_with_all_types(world)
    answer = await call_ours(shared_peer, ours, method, {"count": 8, "gain": "text", "missing": 1})
    if method == "set_parameters":
        assert [one["successful"] for one in answer["results"]] == [True, False, False]
        assert ours.get_parameter("count") == 8
    else:
        assert not answer["result"]["successful"] and ours.get_parameter("count") == VALUES["count"]
    await call_ours(shared_peer, ours, method, NEW)
    assert as_lists(ours.get_parameters(list(NEW))) == list(NEW.values())


async def test_their_whole_number_is_our_double_and_ours_theirs(world: Any, shared_peer: Peer, theirs: Any) -> None:
    ours = node_with_all_types(world)
    wanted = {"gain": 3, "gains": [1, 2], "count": 4}
    answer = await call_ours(shared_peer, ours, "set_parameters", wanted)
    assert [one["successful"] for one in answer["results"]] == [True] * 3
    assert repr(as_lists(ours.get_parameters(list(wanted)))) == "[3.0, [1.0, 2.0], 4]"
    assert [one.successful for one in await theirs.set(wanted, WAIT_S)] == [True] * 3
    assert (await theirs.set_atomically({"gain": 5, "count": 6}, WAIT_S)).successful
    assert repr(await their_values(shared_peer, theirs, list(wanted))) == "[5.0, [1.0, 2.0], 6]"


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_their_client_loads_a_file_into_our_node(world: Any, shared_peer: Peer, tmp_path: Path) -> None:
    ours = node_with_all_types(world)
    file = tmp_path / "parameters.yaml"
    file.write_text(FILE.format(ours.fully_qualified_name))
    await call_ours(shared_peer, ours, "load_parameter_file", str(file))
    assert as_lists(ours.get_parameters(["count", "arm.left.labels"])) == [11, ["ab", "cd"]]


@pytest.mark.only_with("jazzy", "kilted", "lyrical")
async def test_their_client_undeclares_our_dynamic_parameter(world: Any, shared_peer: Peer) -> None:
    ours = node_with_all_types(world)
    ours.declare_parameter("dynamic", 1, ParameterDescriptor(dynamic_typing=True))
    answer = await call_ours(shared_peer, ours, "delete_parameters", ["dynamic"])
    assert [one["successful"] for one in answer["results"]] == [True] and not ours.has_parameter("dynamic")


async def test_they_hear_of_changes_of_our_parameters(world: Any, shared_peer: Peer) -> None:
    ours = node_with_all_types(world)
    topic, name = "/parameter_events", ours.fully_qualified_name
    await shared_peer.do("subscribe", topic=topic, type="rcl_interfaces/msg/ParameterEvent", qos=THEIR_QOS)
    await shared_peer.do("matched", topic=topic, count=2)  # their own node is one
    await until(lambda: any(one.node_name == shared_peer.name for one in ours.get_subscriptions_info_by_topic(topic)))

    async def from_us() -> list[Any]:
        while True:
            (event,) = await shared_peer.do("take", topic=topic)
            if event["node"] == name:
                return [(one["name"], member(one["value"])) for one in event["changed_parameters"]]

    assert await repeated(lambda: ours.set_parameter("count", 3), from_us()) == [("count", 3)]


@pytest.fixture
def theirs(world: Any, shared_peer: Peer) -> Any:
    """Return our client for the parameters of a new node of the peer with all types of values."""
    name = fresh("theirs")
    shared_peer.start("add_node", name=name.strip("/")).result(WAIT_S)
    shared_peer.start("declare", node=name.strip("/"), parameters=VALUES).result(WAIT_S)
    return world.node("tester").create_parameter_client(name)


async def their_values(peer: Peer, client: Any, names: list[str]) -> Any:
    return await peer.do("parameters", node=client.node.strip("/"), names=names)


async def test_our_client_reads_their_parameters(theirs: Any) -> None:
    names = list(VALUES)
    assert as_lists(await theirs.get(names, WAIT_S)) == list(VALUES.values())
    assert await theirs.get_types(names, WAIT_S) == TYPES
    assert [one.type for one in await theirs.describe(names, WAIT_S)] == TYPES
    with pytest.raises(ParameterNotDeclaredError):
        await theirs.get("missing", WAIT_S)
    assert set(VALUES) <= set((await theirs.list(timeout_s=WAIT_S)).names)
    listing = await theirs.list("arm", timeout_s=WAIT_S)
    assert list(listing.names) == ["arm.left.labels"]
    assert {"arm.left"} <= set(listing.prefixes) <= {"arm.left", "arm"}  # Humble tells what is above as well


async def test_our_client_sets_their_parameters(theirs: Any, shared_peer: Peer) -> None:
    assert not (await theirs.set_atomically({"count": 8, "gain": "text"}, WAIT_S)).successful
    assert await their_values(shared_peer, theirs, ["count"]) == [VALUES["count"]]
    results = await theirs.set({**NEW, "missing": 1, "gain": "text"}, WAIT_S)
    assert [one.successful for one in results] == [True] * 4 + [False] * 2
    assert await their_values(shared_peer, theirs, list(NEW)) == list(NEW.values())
    assert (await theirs.set_atomically({"count": 9}, WAIT_S)).successful
    assert await their_values(shared_peer, theirs, ["count"]) == [9]


async def test_our_client_loads_and_dumps_a_file_of_their_node(theirs: Any, shared_peer: Peer, tmp_path: Path) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(FILE.format(theirs.node))
    assert all(result.successful for result in (await theirs.load_yaml(file, WAIT_S)).values())
    assert await their_values(shared_peer, theirs, ["count", "arm.left.labels"]) == [11, ["ab", "cd"]]
    assert "count: 11" in await theirs.dump_yaml(WAIT_S)


async def test_we_hear_of_changes_of_their_parameters(theirs: Any) -> None:
    events = theirs.events()
    assert await events.wait_for_publishers(WAIT_S)

    async def changed() -> Any:
        async for event in events:
            if event.event.changed:
                return event

    async def change() -> None:
        assert (await theirs.set({"count": 3}, WAIT_S))[0].successful

    event = await repeated(change, changed())
    assert event.node == theirs.node
    assert [(one.name, one.value.value) for one in event.event.changed] == [("count", 3)]
