"""Effects of signals and shutdowns under rclpy; the argument is the case. Run under both rclpys."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from functools import partial

import rclpy
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions as O
from rclpy.signals import get_current_signal_handlers_options as g
from rclpy.signals import uninstall_signal_handlers

mode = sys.argv[1]
rclpy.init()
node = Node("sig")


def later(n):
    """Send the signal once the main thread waits, which is observed five times in a row."""
    stat = f"/proc/self/task/{threading.main_thread().native_id}/stat"

    def f():
        looks = 0
        while looks < 5:
            time.sleep(0.02)  # between two looks
            with open(stat) as file:
                looks = looks + 1 if file.read().rpartition(")")[2].split()[0] == "S" else 0
        os.kill(os.getpid(), n)
        while os.environ["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp":  # real rclpy: 2 of 100 times it wakes no executor
            time.sleep(2)
            with contextlib.suppress(Exception):
                node.executor.wake()

    threading.Thread(target=f, daemon=True).start()


def sleep_until_the_signal():
    time.sleep(5)  # what the signal interrupts


def until(condition):
    end = time.monotonic() + 5
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)


def show(f):
    try:
        r = f()
        print("returned", r)
    except BaseException as e:
        print("raised", type(e).__name__)
        # Real rclpy shuts down in a thread of its own, beside KeyboardInterrupt.
        if isinstance(e, KeyboardInterrupt) and mode.startswith("int"):
            until(lambda: not rclpy.ok())
    print("ok", rclpy.ok())


if mode == "int_spin":
    later(signal.SIGINT)
    show(lambda: rclpy.spin(node))
    show(node.destroy_node)
    show(rclpy.shutdown)
    show(rclpy.try_shutdown)
if mode == "options":
    print(g() == O.ALL)
    uninstall_signal_handlers()
    print(g() == O.NO)
    rclpy.shutdown()
    rclpy.init(signal_handler_options=O.SIGTERM)
    print(g() == O.SIGTERM)
    hits = []
    signal.signal(signal.SIGTERM, lambda *a: hits.append(1))
    os.kill(os.getpid(), signal.SIGTERM)
    print(hits, rclpy.ok())
    rclpy.shutdown()
if mode == "spin_again_after":
    executors = [SingleThreadedExecutor(), MultiThreadedExecutor()]
    rclpy.spin_once(node, timeout_sec=0.01)  # makes the global executor
    later(signal.SIGINT)
    try:
        sleep_until_the_signal()
    except KeyboardInterrupt:
        while rclpy.ok():
            time.sleep(0.01)
    for limit in (None, 0, 0.1):
        show(partial(rclpy.spin_once, node, timeout_sec=limit))
        for executor in executors:
            show(partial(executor.spin_once, timeout_sec=limit))
            show(executor.spin)
    show(lambda: rclpy.spin(node))
    show(SingleThreadedExecutor)
