"""Executors, futures, services, timers and the graph of rclpy, case by case. Run under both rclpys.

Arguments: names of cases. The output of a case follows a line with its name.
"""

from __future__ import annotations

import asyncio
import gc
import sys
import threading
import time
import warnings
import weakref
from typing import Any

import rclpy
import rclpy.logging
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import SetBool

node: Any = None


def show(f):
    try:
        r = f()
        print("returned", r)
    except BaseException as e:
        print("raised", type(e).__name__)


def until(condition):
    end = time.time() + 10
    while not condition() and time.time() < end:
        time.sleep(0.01)


def let_arrive():
    time.sleep(0.4)  # nothing tells what has arrived before somebody spins


def connected(pub, n=1):
    until(lambda: pub.get_subscription_count() >= n)


def spin_until(cond, ex=None, limit=10.0):
    end = time.time() + limit
    while not cond() and time.time() < end:
        rclpy.spin_once(node, executor=ex, timeout_sec=0.05)


def nobody_spins():
    got = []
    node.create_subscription(String, "t", lambda m: got.append(m.data), 3)
    pub = node.create_publisher(String, "t", 10)
    connected(pub)
    for i in range(6):
        pub.publish(String(data=str(i)))
    let_arrive()
    print(got)
    sizes = []
    for _ in range(20):
        before = len(got)
        rclpy.spin_once(node, timeout_sec=0.05)
        sizes.append(len(got) - before)
    print(max(sizes), got)
    node.create_service(SetBool, "flip", lambda q, r: r)
    print(node.create_client(SetBool, "flip").call(SetBool.Request(), timeout_sec=0.2))


def order():
    got = []
    group = ReentrantCallbackGroup()
    node.create_subscription(String, "t", lambda m: got.append("sub"), 10, callback_group=group)
    guard = node.create_guard_condition(lambda: got.append("guard"), group)
    node.create_service(SetBool, "add", lambda q, r: (got.append("service"), r)[1], callback_group=group)
    cli = node.create_client(SetBool, "add", callback_group=group)
    cli.wait_for_service(10)
    pub = node.create_publisher(String, "t", 10)
    connected(pub)
    spin_until(lambda: False, limit=0.3)
    timer = node.create_timer(0.05, lambda: (got.append("timer"), timer.cancel()), group)
    pub.publish(String())
    cli.call_async(SetBool.Request())
    for _ in range(3):
        guard.trigger()  # called back once
    let_arrive()
    spin_until(lambda: len(got) >= 4)
    rclpy.spin_once(node, timeout_sec=0.1)
    print(got, node.destroy_guard_condition(guard))
    show(guard.trigger)


def nested():
    def call_in_callback(group, limit):
        cli = node.create_client(SetBool, "add", callback_group=group)
        cli.wait_for_service(10)
        out = []

        def tick():
            timer.cancel()
            f = cli.call_async(SetBool.Request())
            rclpy.spin_until_future_complete(node, f, timeout_sec=limit)
            out.append(f.done())

        timer = node.create_timer(0.05, tick)
        spin_until(lambda: out)
        print(out)

    node.create_service(SetBool, "add", lambda q, r: r, callback_group=ReentrantCallbackGroup())
    call_in_callback(MutuallyExclusiveCallbackGroup(), 5)
    call_in_callback(None, 1)  # the group of the timer


def futures():
    f = Future()
    print(f.done(), f.cancelled(), f.result(), f.exception())
    f.cancel()
    print(f.done(), f.cancelled(), f.result())
    f = Future()
    seen = []
    f.add_done_callback(lambda x: seen.append(x.result()))
    f.set_result(3)
    print(seen)
    f.add_done_callback(lambda x: seen.append("late"))
    print(seen)
    f = Future()
    f.set_exception(ValueError("v"))
    show(f.result)
    f = Future()
    f.add_done_callback(lambda x: 1 / 0)
    with warnings.catch_warnings(record=True) as w:
        warnings.simplefilter("always")
        f.set_result(1)
        print([str(x.message) for x in w])
    f = Future()
    c = seen.append
    f.add_done_callback(c)
    print(f.remove_done_callback(c), f.remove_done_callback(c))


def tasks():
    ex = SingleThreadedExecutor()
    ex.add_node(node)

    async def waits():
        await Future()

    t = ex.create_task(lambda: 1 / 0)
    show(lambda: ex.spin_until_future_complete(t, 2.0))
    print(type(t.exception()).__name__)
    t = ex.create_task(waits)
    t.cancel()
    ex.spin_once(timeout_sec=0.1)
    print(t.cancelled(), t.done())

    async def sleeper():
        await asyncio.sleep(0.1)  # refused: asyncio does not run

    t = ex.create_task(sleeper)
    show(lambda: ex.spin_until_future_complete(t, 2.0))


def futures_in_asyncio():
    async def spin():
        while True:
            rclpy.spin_once(node, timeout_sec=0)
            await asyncio.sleep(0.001)

    async def asynchronous():
        spinning = asyncio.ensure_future(spin())
        first, second = Future(), Future()
        timer = node.create_timer(0.02, lambda: first.set_result("a"))
        asyncio.get_running_loop().call_later(0.02, second.set_result, "b")
        print(await first, await second)
        timer.cancel()
        spinning.cancel()

    asyncio.run(asynchronous())
    inner = rclpy.get_global_executor().create_task(lambda: asyncio.run(asynchronous()))
    spin_until(inner.done)
    print(inner.exception())


def topics():
    for qos in (None, 1.5):
        show(lambda qos=qos: node.create_publisher(String, "t", qos) and None)
    show(lambda: node.create_client(SetBool, "b ad"))
    show(lambda: node.create_subscription(String, "t", lambda a, b, c: 1, 1))
    p = node.create_publisher(String, "rel", 1)
    print(p.topic, p.topic_name)
    p = node.create_publisher(String, "~/p", 1)
    print(p.topic, p.topic_name, node.resolve_topic_name("~/x"), node.resolve_service_name("s"))
    s = node.create_subscription(String, "u", lambda message: None, 10)
    print(node.destroy_subscription(s), node.destroy_subscription(s))
    show(lambda: s.get_publisher_count())
    print(node.destroy_publisher(p))
    show(p.destroy)


def weak_nodes():
    n = Node("weak", start_parameter_services=False)
    r = weakref.ref(n)
    n.destroy_node()
    del n
    gc.collect()
    print(r() is None)


def created_while_spinning():
    ex = SingleThreadedExecutor()
    ex.add_node(node)
    th = threading.Thread(target=ex.spin)
    th.start()
    hit = threading.Event()
    ex.create_task(hit.set)
    print(hit.wait(5))  # it spins
    hit.clear()
    node.create_timer(0.05, hit.set)
    print(hit.wait(5))
    f = Future()
    threading.Timer(0.2, lambda: f.set_result(1)).start()
    b = time.time()
    other = Node("o2")
    rclpy.spin_until_future_complete(other, f, timeout_sec=5)
    print(f.done(), time.time() - b < 4.5)
    cleared = threading.Event()
    ex.create_task(lambda: (hit.clear(), cleared.set()))
    print(cleared.wait(5), hit.wait(5))
    ex.shutdown()
    th.join()


def results_expire_while_nothing_arrives():
    from rclpy.action import ActionClient, ActionServer
    from test_msgs.action import Fibonacci

    def execute(goal):
        goal.succeed()
        return Fibonacci.Result(sequence=[1])

    other = Node("serving", start_parameter_services=False)
    server = ActionServer(other, Fibonacci, "fib", execute, result_timeout=0.5)
    client = ActionClient(node, Fibonacci, "fib")
    ex = SingleThreadedExecutor()
    ex.add_node(other)
    th = threading.Thread(target=ex.spin)
    th.start()
    print(client.wait_for_server(10))
    future = client.send_goal_async(Fibonacci.Goal())
    rclpy.spin_until_future_complete(node, future, timeout_sec=10)
    until(lambda: not server._goal_handles)
    result = future.result().get_result_async()
    rclpy.spin_until_future_complete(node, result, timeout_sec=10)
    print(result.result().status)
    ex.shutdown()
    th.join()


def mismatches_are_logged():
    texts, kept = [], rclpy.logging._root_logger
    rclpy.logging._root_logger = Listener(texts)
    node.create_publisher(String, "mis", 10)
    node.create_subscription(String, "mis", print, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    spin_until(lambda: len(texts) == 2)
    rclpy.logging._root_logger = kept
    print(sorted(texts))


class Listener:
    def __init__(self, texts):
        self.warn = texts.append

    def get_child(self, name):
        return self


def main() -> None:
    global node
    warnings.simplefilter("ignore")
    for name in sys.argv[1:]:
        print("==", name)
        rclpy.init()
        node = Node("sem", start_parameter_services=False)
        globals()[name]()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
