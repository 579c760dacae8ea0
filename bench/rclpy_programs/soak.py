"""Program that bench/rclpy.py runs for a long time: ``soak.py SECONDS``. Ends with 1 if it stalls or grows.

One MultiThreadedExecutor serves two nodes: timers whose callbacks call a service and wait in it, an action of which a
thread asks, parameters that are read and set by services, topics, and entities that are made and destroyed all the
time. Each second a line tells what was done so far, memory, threads and descriptors.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

import rclpy
from example_interfaces.action import Fibonacci
from example_interfaces.srv import AddTwoInts
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String

PATIENCE_S = 20.0
GROWTH_MB = 6.0
WARM_UP = 0.2
"""This share of the time may grow."""


def rss_mb() -> float:
    """Resident memory of this process now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


class Server(Node):
    """Answers."""

    def __init__(self) -> None:
        super().__init__("server")
        group = ReentrantCallbackGroup()
        self.declare_parameter("number", 1)
        self.create_service(AddTwoInts, "add", self.add, callback_group=group)
        self.action = ActionServer(self, Fibonacci, "fibonacci", self.execute, callback_group=group, result_timeout=2)
        self.publisher = self.create_publisher(String, "chatter", 10)
        self.create_timer(0.005, lambda: self.publisher.publish(String(data="hello")))

    def add(self, request: Any, response: Any) -> Any:
        """The sum, a moment later."""
        time.sleep(0.001)
        response.sum = request.a + request.b
        return response

    def execute(self, goal_handle: Any) -> Any:
        """Some numbers, with feedback."""
        feedback = Fibonacci.Feedback(sequence=[0, 1])
        for number in range(1, goal_handle.request.order):
            feedback.sequence.append(feedback.sequence[number] + feedback.sequence[number - 1])
            goal_handle.publish_feedback(feedback)
        goal_handle.succeed()
        return Fibonacci.Result(sequence=feedback.sequence)


class Client(Node):
    """Asks, and waits in callbacks."""

    def __init__(self) -> None:
        super().__init__("client")
        self.counts = dict.fromkeys(("calls", "goals", "feedback", "messages", "parameters", "made"), 0)
        other = ReentrantCallbackGroup()
        self.adding = self.create_client(AddTwoInts, "add", callback_group=other)
        self.getting = self.create_client(GetParameters, "/server/get_parameters", callback_group=other)
        self.setting = self.create_client(SetParameters, "/server/set_parameters", callback_group=other)
        self.action = ActionClient(self, Fibonacci, "fibonacci", callback_group=other)
        self.create_subscription(String, "chatter", lambda _: self.count("messages"), 10)
        for what, period_s in ((self.add, 0.01), (self.parameters, 0.05), (self.make, 0.1), (self.ask, 0.05)):
            self.create_timer(period_s, what, callback_group=MutuallyExclusiveCallbackGroup())

    def count(self, what: str) -> None:
        """Count an event."""
        self.counts[what] += 1

    def add(self) -> None:
        """A blocking call in a callback."""
        response = self.adding.call(AddTwoInts.Request(a=self.counts["calls"], b=1), timeout_sec=PATIENCE_S)
        assert response.sum == self.counts["calls"] + 1
        self.count("calls")

    def parameters(self) -> None:
        """Two blocking calls in a callback."""
        number = Parameter("number", value=self.counts["parameters"]).to_parameter_msg()
        response = self.setting.call(SetParameters.Request(parameters=[number]), timeout_sec=PATIENCE_S)
        assert response.results[0].successful
        response = self.getting.call(GetParameters.Request(names=["number"]), timeout_sec=PATIENCE_S)
        assert response.values[0].integer_value == self.counts["parameters"]
        self.count("parameters")

    def make(self) -> None:
        """Entities that come and go."""
        publisher = self.create_publisher(String, "short", 10)
        subscription = self.create_subscription(String, "short", lambda _: None, 10)
        timer = self.create_timer(0.001, lambda: publisher.publish(String(data="x")))
        time.sleep(0.005)
        self.destroy_timer(timer)
        self.destroy_subscription(subscription)
        self.destroy_publisher(publisher)
        self.count("made")

    async def ask(self) -> None:
        """A goal, awaited in a callback."""
        handle = await self.action.send_goal_async(Fibonacci.Goal(order=5), lambda _: self.count("feedback"))
        result = await handle.get_result_async()
        assert len(result.result.sequence) == 6
        self.count("goals")


def main() -> int:
    """Watch, while the executor spins in another thread."""
    seconds = float(sys.argv[1])
    rclpy.init(args=[])
    server, client = Server(), Client()
    executor = MultiThreadedExecutor(8)
    executor.add_node(server)
    executor.add_node(client)
    errors: list[BaseException] = []

    def spin() -> None:
        try:
            executor.spin()
        except BaseException as error:
            errors.append(error)

    spinning = threading.Thread(target=spin)
    spinning.start()
    begin, first, stuck = time.monotonic(), None, ""
    last = dict.fromkeys(client.counts, (0, begin))
    while time.monotonic() < begin + seconds and not errors and not stuck:
        time.sleep(min(seconds / 20, 5))
        now = time.monotonic()
        found = rss_mb(), threading.active_count(), len(os.listdir("/proc/self/fd"))
        print(f"{now - begin:6.0f} s {client.counts} {found[0]:.1f} MB {found[1]} threads {found[2]} fds", flush=True)
        for name, count in client.counts.items():
            if count != last[name][0]:
                last[name] = count, now
            elif now > last[name][1] + PATIENCE_S:
                stuck = f"{name} stand still"
        if first is None and now > begin + WARM_UP * seconds:
            first = found
    executor.shutdown()
    spinning.join(PATIENCE_S)
    if spinning.is_alive():
        stuck = "the executor does not end"
    if first is not None and (found[0] > first[0] + GROWTH_MB or found[1] > first[1] + 2 or found[2] > first[2] + 2):
        stuck = f"from {first} to {found}: MB, threads, descriptors"
    print("failed: " + str(errors or stuck) if errors or stuck else "no hang, no growth", flush=True)
    rclpy.shutdown()
    return bool(errors or stuck)


if __name__ == "__main__":
    sys.exit(main())
