"""Programs for rclpy of Lyrical, and with ROS_DISTRO=lyrical."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from support.local_network import domain_id
from support.program_processes import output_lines, run

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.real_time("programs are processes")
PROGRAM = """
import time, rclpy
from lifecycle_msgs.msg import TransitionEvent
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

class Managed(LifecycleNode):
    def on_configure(self, state):
        return TransitionCallbackReturn.SUCCESS

class Broken(LifecycleNode):
    def on_configure(self, state):
        raise ValueError("broken")

def spin_until(condition):
    end = time.monotonic() + 20
    while not condition() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)

rclpy.init()
node, seen = Managed("managed"), []
node.create_subscription(TransitionEvent, "~/transition_event", seen.append, 10)
spin_until(lambda: node._rosidl_transition_events.get_subscription_count() > 0)
node.trigger_configure()
Broken("broken").trigger_configure()
spin_until(lambda: len(seen) == 2)
for event in seen:
    print(event.stamp.sec > 0, event.transition.id, event.transition.label, event.goal_state.label)
"""


def test_lifecycle_events_have_definition_of_selected_distribution(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM, encoding="utf-8")
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    done = run(program, ROS_DISTRO="lyrical", **settings)
    assert done.stdout.splitlines() == ["True 1 configure configuring", "True 10 transition_success inactive"], (
        done.stderr
    )
    assert "[broken]: on_configure raised ValueError: broken\n" in done.stderr  # rclpy does not log it


SERVICES = """
import time, rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.endpoint_info import EndpointTypeEnum, ServiceEndpointInfo, TopicEndpointInfo
from example_interfaces.action import Fibonacci
from std_srvs.srv import Trigger
from rclpy.topic_endpoint_info import TopicEndpointInfo as OldInfo, TopicEndpointTypeEnum

def wait_until(condition):
    end = time.monotonic() + 20
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)

with rclpy.init(), rclpy.create_node("one", namespace="/ns") as one, rclpy.create_node("two") as two:
    one.create_client(Trigger, "trigger")
    two.create_client(Trigger, "/ns/trigger")
    two.create_service(Trigger, "/ns/trigger", lambda request, response: response)
    wait_until(lambda: len(one.get_clients_info_by_service("trigger")) == 2)
    wait_until(lambda: one.get_servers_info_by_service("trigger"))
    clients = sorted(one.get_clients_info_by_service("trigger"), key=lambda info: info.node_name)
    infos = [*clients, *one.get_servers_info_by_service("trigger")]
    for info in infos:
        print(info.node_namespace, info.node_name, info.service_type, info.endpoint_type.name, info.endpoint_count)
    print(len({bytes(gid) for info in infos for gid in info.endpoint_gids}), len(infos[0].qos_profiles))
    print(str(infos[0].service_type_hash)[:7], "Request Writer" in str(infos[0]), "Response Writer" in str(infos[2]))
    try:
        one.get_clients_info_by_service("trigger", no_mangle=True)
    except RuntimeError as error:
        print(str(error).partition(";")[0])
    ActionClient(one, Fibonacci, "count")
    ActionServer(two, Fibonacci, "/ns/count", lambda goal: Fibonacci.Result())
    wait_until(lambda: two.get_action_client_names_and_types_by_node("one", "/ns"))
    print(one.get_action_names_and_types())
    print(two.get_action_client_names_and_types_by_node("one", "/ns"))
    print(one.get_action_server_names_and_types_by_node("two", "/"))
    print(OldInfo is TopicEndpointInfo, TopicEndpointTypeEnum is EndpointTypeEnum)

print(ServiceEndpointInfo() == ServiceEndpointInfo(), ServiceEndpointInfo(endpoint_count=1) == ServiceEndpointInfo())
for fields in ({"endpoint_gids": [1]}, {"qos_profiles": [1]}, {"endpoint_count": "1"}, {"service_type": 1}):
    try:
        ServiceEndpointInfo(**fields)
    except AssertionError as error:
        print(error)
"""
OTHERS = """
import time, rclpy
from rclpy.clock import ClockType
from rclpy.duration import Duration, Infinite
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSPresetProfiles, QoSProfile, qos_profile_rosout_default
from rclpy.publisher import Publisher
from rclpy.time import Time
from rclpy.timer import TimerInfo
from std_msgs.msg import String

class Typed(Node):
    publisher: Publisher[String]
    value: Parameter[int]

def on_timer(info: TimerInfo):
    calls.append(info)

print(Duration(seconds=1) + Duration(seconds=2), Duration(seconds=3) - Duration(seconds=1))
print(Duration(seconds=1) * 0.5, Duration(seconds=1) * float("inf") == Infinite)
print(Time(seconds=5.5).to_datetime().timestamp())
print(QoSPresetProfiles.ROSOUT_DEFAULT.value == qos_profile_rosout_default, qos_profile_rosout_default.depth)
calls = []
with rclpy.init(), Typed("typed", rosout_qos_profile=QoSProfile(depth=3)) as node:
    [rosout] = node.get_publishers_info_by_topic("/rosout")
    print(rosout.qos_profile.durability.name)
    timer = node.create_timer(0.01, on_timer)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    future = executor.create_future()
    print(executor.is_spinning)
    future.add_done_callback(lambda _: print(executor.is_spinning))
    executor.create_task(lambda: future.set_result(None))
    executor.spin_until_future_complete(future)
    while len(calls) < 2:
        executor.spin_once()
    print(type(calls[0]).__name__, calls[0].actual_call_time >= calls[0].expected_call_time)
    publisher = node.create_publisher(String, "names", 1)
    with publisher:
        print(publisher in node.publishers)
    print(publisher in node.publishers, timer in node.timers)
    threads = MultiThreadedExecutor(2)
    done = []
    task = threads.create_task(lambda: (time.sleep(0.1), done.append(True)))
    threads.spin_once()
    threads.shutdown(wait_for_threads=True)
    print(done)
rclpy.try_shutdown(uninstall_handlers=True)
"""
ACTIONS = """
import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionClient, ActionServer

def accept(handle):
    handle.executing()
    handle.succeed(Fibonacci.Result(sequence=[handle.request.order]))

with rclpy.init(), rclpy.create_node("actions") as node:
    server = ActionServer(node, Fibonacci, "count", handle_accepted_callback=accept)
    client = ActionClient(node, Fibonacci, "count", enable_feedback_msg_optimization=True)
    client.wait_for_server(20)
    handle = client.send_goal_async(Fibonacci.Goal(order=7))
    rclpy.spin_until_future_complete(node, handle, timeout_sec=20)
    result = handle.result().get_result_async()
    rclpy.spin_until_future_complete(node, result, timeout_sec=20)
    print(result.result().status, list(result.result().result.sequence))
"""


def in_domain(folder: Path, program: str) -> list[str]:
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    return output_lines(folder, program, **settings)


def test_clients_servers_and_actions_are_listed_as_in_rclpy_10(tmp_path: Path) -> None:
    assert in_domain(tmp_path, SERVICES) == [
        "/ns one std_srvs/srv/Trigger CLIENT 2",
        "/ two std_srvs/srv/Trigger CLIENT 2",
        "/ two std_srvs/srv/Trigger SERVER 2",
        "6 2",
        "RIHS01_ True True",
        "no_mangle: got True for a service",
        *["[('/ns/count', ['example_interfaces/action/Fibonacci'])]"] * 3,
        "True True",
        "True False",
        "endpoint_gids must be lists of int, got 1",
        "qos_profiles must be QoSProfile or dict, got 1",
        "endpoint_count must be int, got '1'",
        "service_type must be str, got 1",
    ]


def test_other_additions_of_rclpy_10_work(tmp_path: Path) -> None:
    assert in_domain(tmp_path, OTHERS) == [
        "3000000000 nanoseconds 2000000000 nanoseconds",
        "500000000 nanoseconds True",
        "5.5",
        "True 1000",
        "VOLATILE",
        "False",
        "True",
        "TimerInfo True",
        "True",
        "False True",
        "[True]",
    ]


def test_goals_succeed_without_execute_callback(tmp_path: Path) -> None:
    assert in_domain(tmp_path, ACTIONS) == ["4 [7]"]
