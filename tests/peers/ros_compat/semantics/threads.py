"""Interactions of several threads of one program under our rclpy; the argument is the case."""

from __future__ import annotations

import gc
import sys
import threading
from typing import Any

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import String
from std_srvs.srv import SetBool


def counted_subscriptions(node: Node) -> None:
    def publish() -> None:
        publisher = node.create_publisher(String, "t", 1)
        while node.count_subscribers("t") == 0:
            pass
        publisher.publish(String(data="x"))
        node.destroy_publisher(publisher)

    assert wait_for_message(String, node, "t", time_to_wait=0.1) == (False, None)
    for _ in range(80):
        thread = threading.Thread(target=publish)
        thread.start()
        assert wait_for_message(String, node, "t", time_to_wait=10) == (True, String(data="x"))
        thread.join()


def services_of_services(node: Node) -> None:
    group, count = ReentrantCallbackGroup(), 200
    answers: list[bool] = []
    heard: list[Any] = []
    executor = MultiThreadedExecutor(4)

    async def inner(request: Any, response: Any) -> Any:
        response.success = request.data
        return response

    def outer(request: Any, response: Any) -> Any:
        response.success = inner_client.call(request, timeout_sec=10).success
        return response

    def tick() -> None:
        if len(answers) == count:
            timer.cancel()
            return
        answers.append(outer_client.call(SetBool.Request(data=True), timeout_sec=10).success)
        publisher.publish(String())

    def hear(message: Any) -> None:
        heard.append(message)
        if len(heard) == count:
            executor.shutdown()

    node.create_service(SetBool, "inner", inner, callback_group=group)
    node.create_service(SetBool, "outer", outer, callback_group=group)
    inner_client = node.create_client(SetBool, "inner", callback_group=MutuallyExclusiveCallbackGroup())
    outer_client = node.create_client(SetBool, "outer", callback_group=MutuallyExclusiveCallbackGroup())
    publisher = node.create_publisher(String, "t", 10)
    node.create_subscription(String, "t", hear, 10, callback_group=MutuallyExclusiveCallbackGroup())
    assert inner_client.wait_for_service(10) and outer_client.wait_for_service(10)
    timer = node.create_timer(0.001, tick, MutuallyExclusiveCallbackGroup())
    executor.add_node(node)
    executor.spin()
    assert answers == [True] * count
    # The shutdown may cut off what the last call left to do, as its answer is told first.
    left = len(executor._tasks), len(outer_client._pending_requests)
    assert left[0] < 10 and left[1] <= 1, left


def groups_of_what_was_destroyed(node: Node) -> None:
    for group in (MutuallyExclusiveCallbackGroup(), ReentrantCallbackGroup()):
        for _ in range(3):
            node.destroy_subscription(node.create_subscription(String, "t", lambda _: None, 1, callback_group=group))
            node.destroy_timer(node.create_timer(1.0, lambda: None, callback_group=group))
        gc.collect()
        assert group.entities == set()


def peers_found_during_creation(node: Node) -> None:
    handle, executor = node.context.handle, MultiThreadedExecutor(2)
    loop, errors = handle.loop_runner.loop, list[Any]()

    def find_peer() -> None:
        handle.runtime.on_incompatible_endpoint("not logged", "/t0")
        loop.call_soon(find_peer)

    loop.set_debug(True)  # its functions refuse calls of other threads
    loop.set_exception_handler(lambda _, context: errors.append(context))
    sys.setswitchinterval(1e-6)
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin, daemon=True)
    spinning.start()
    created = [node.create_publisher(String, "t0", 1)]
    loop.call_soon_threadsafe(find_peer)
    created += [node.create_publisher(String, f"t{number}", 1) for number in range(1, 300)]
    executor.shutdown()
    spinning.join()
    assert errors == []


def own_endpoints_while_another_thread_spins(node: Node) -> None:
    executor, missing = MultiThreadedExecutor(2), list[str]()
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin, daemon=True)
    spinning.start()
    name, namespace = node.get_name(), node.get_namespace()
    for number in range(100):
        node.create_publisher(String, f"p{number}", 1)
        if f"/p{number}" not in dict(node.get_publisher_names_and_types_by_node(name, namespace)):
            missing.append(f"publisher {number}")
        node.create_subscription(String, f"s{number}", lambda message: None, 1)
        if not node.get_subscriptions_info_by_topic(f"s{number}"):
            missing.append(f"subscription {number}")
        node.create_service(SetBool, f"v{number}", print)
        if node.count_services(f"v{number}") != 1:
            missing.append(f"service {number}")
    executor.shutdown()
    spinning.join()
    # A loop that is busy for longer than the limit of the wait may miss one on a machine under load.
    assert len(missing) <= 3, missing


rclpy.init()
one = Node("threads", start_parameter_services=False)
globals()[sys.argv[1]](one)
one.destroy_node()
rclpy.try_shutdown()
print("done")
