"""QoS and type hashes of the parameter endpoints of a node (docs/internals/protocol.md 7.2, 9.1)."""

from __future__ import annotations

import pytest
from support.node_fixtures import World, run, until

from rosidl_py_gen.runtime import Durability, History, QoSProfile, Reliability
from rosidl_py_gen.runtime.transport.api import TopicKey
from rosidl_py_gen.runtime.transport.qos import PARAMETER_EVENTS, PARAMETERS

SERVICES = [
    "describe_parameters",
    "get_parameters",
    "get_parameter_types",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
]


def policies(qos: QoSProfile) -> tuple[History, int, Reliability, Durability]:
    return qos.history, qos.depth, qos.reliability, qos.durability


def test_the_profiles_are_those_of_ros() -> None:
    expected = (History.KEEP_LAST, 1000, Reliability.RELIABLE, Durability.VOLATILE)
    assert policies(PARAMETERS) == policies(PARAMETER_EVENTS) == expected


@pytest.mark.every_transport
async def test_parameter_events_are_announced_with_depth_1000(world: World) -> None:
    node, other = world.node("n"), world.node("other")
    stream = other.parameter_events()
    await until(lambda: len(other.get_publishers_info_by_topic("/parameter_events")) == 2)
    await until(lambda: len(node.get_subscriptions_info_by_topic("/parameter_events")) == 1)
    found = [
        *other.get_publishers_info_by_topic("/parameter_events"),
        *node.get_subscriptions_info_by_topic("/parameter_events"),
    ]
    for info in found:
        assert policies(info.qos_profile) == (History.KEEP_LAST, 1000, Reliability.RELIABLE, Durability.VOLATILE)
        assert info.topic_type == "rcl_interfaces/msg/ParameterEvent"
    stream.close()


@pytest.mark.every_transport
@pytest.mark.parametrize("service", SERVICES)
def test_the_services_are_reliable_volatile_and_drop_nothing(world: World, service: str) -> None:
    """History takes no part in matching; ours keeps all where rclpy keeps 1000, so that no call is overwritten."""

    async def main() -> None:
        world.node("n")
        other = world.node("other")
        remote = other.create_parameter_client("/n")
        topic_keys = TopicKey("request", f"/n/{service}"), TopicKey("reply", f"/n/{service}")

        def endpoints() -> list[QoSProfile]:
            other._scope.discovery.refresh()
            return [one.qos for one in other._scope.graph.endpoints.values() if one.topic_key in topic_keys]

        await until(lambda: len(endpoints()) == 4)  # two of the server, two of the client
        for qos in endpoints():
            assert policies(qos) == (History.KEEP_ALL, 0, Reliability.RELIABLE, Durability.VOLATILE)
        remote.close()

    run(main)
