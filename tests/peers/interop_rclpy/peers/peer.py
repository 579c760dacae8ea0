"""A real rclpy node that executes the commands of its test, one line of JSON each.

The first line written is READY. Each line read is ``{"id", "do", ...}`` and is answered, perhaps much later, by
``{"id", "result"}`` or ``{"id", "error"}``; commands are coroutines, so that a waiting one blocks no other. The process
ends when its input does.
"""

import inspect
import json
import os
import sys
import threading
import traceback
from contextlib import suppress
from functools import partial

import rclpy
from rclpy._rclpy_pybind11 import InvalidHandle
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor

import humble  # isort: skip  # noqa: F401 - completes rclpy
import actions  # isort: skip
import nodes  # isort: skip
import services  # isort: skip
import topics  # isort: skip

MODULES = (topics, services, actions, nodes)
ANSWERS = os.dup(1)
os.dup2(2, 1)  # Zenoh logs to the standard output
STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class Peer:
    """Node and its entities; `entities` is for the modules, by kind and name."""

    def __init__(self, name):
        self.executor = SingleThreadedExecutor()
        self.nodes = {}
        self.entities = {}
        self.node = self.add_node(rclpy.create_node(name))

    def add_node(self, node):
        self.nodes[node.get_name()] = node
        self.executor.add_node(node)
        return node

    def owner(self, kind, thing):
        return next(node for node in self.nodes.values() if thing in getattr(node, kind))

    def new_future(self):
        return rclpy.task.Future(executor=self.executor)

    async def until(self, condition):
        """Check a condition every 20 ms; rclpy does not notify of matched endpoints."""
        while not condition():
            passed = self.new_future()
            timer = self.node.create_timer(0.02, partial(passed.set_result, None), clock=STEADY)
            await passed
            self.node.destroy_timer(timer)


def answer(**content):
    # One write, so that lines of two threads do not mix.
    os.write(ANSWERS, (json.dumps(content) + "\n").encode())


async def execute(peer, line):
    request = json.loads(line)
    number, do = request.pop("id"), request.pop("do")
    try:
        function = next(getattr(module, do) for module in MODULES if hasattr(module, do))
        result = function(peer, **request)
        if inspect.isawaitable(result):
            result = await result
    except Exception:
        answer(id=number, error=traceback.format_exc())
    else:
        answer(id=number, result=result)


def read(peer, ended):
    for line in sys.stdin:
        peer.executor.create_task(execute, peer, line)
    peer.executor.create_task(ended.set)
    threading.Event().wait(60)
    os._exit(1)  # something hangs


def main():
    rclpy.init(args=sys.argv)
    peer = Peer(sys.argv[1])
    ended = threading.Event()
    threading.Thread(target=read, args=(peer, ended), daemon=True).start()
    os.write(ANSWERS, b"READY\n")
    while not ended.is_set():
        with suppress(InvalidHandle):  # it looks once more at what was destroyed between two looks
            peer.executor.spin_once(1)  # Humble may miss a task that another thread has created
    peer.executor.shutdown()
    for node in peer.nodes.values():
        node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
