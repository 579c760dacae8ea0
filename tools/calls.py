"""Count the Python calls that one warm operation takes, and print them.

Run it with ``python tools/calls.py``. Names of operations select some of them: ``python tools/calls.py service goal``.
With ``--list`` each call of these operations is printed, too, in order.

Two contexts of this process communicate on DDS, on the loopback interface, and one event loop serves both. In addition,
`definition` compiles one .msg, and `spin_once` is rclpy's with one message. After some repetitions `sys.setprofile`
counts the calls during one operation, at both ends:

- calls: functions, comprehensions, and continued coroutines and generators of `rosidl_py_gen`. Functions in C, of the
  standard library, of generated messages and of this program do not count.
- files: files of the package with these functions.

Each operation is measured several times, and the smallest count is printed: acknowledgements and timers add calls.
`tests/slow/project/test_calls.py` compares some of the counts with limits.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Iterable
from contextlib import asynccontextmanager
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from rosidl_py_gen import (  # noqa: E402
    compile_definition,
    get_action,
    get_message,
    get_service,
    install_import_hook,
)
from rosidl_py_gen.runtime import Context, Node, run  # noqa: E402

_PACKAGE = f"{ROOT / 'rosidl_py_gen'}{os.sep}"
_DOMAIN_ID = 213
_WARM_UP = 12
"""Number of repetitions before the first measurement: a server trusts a client after some calls."""
_MEASUREMENTS = 5
_SETTLE_S = 0.05
"""Time between two operations, in which acknowledgements and status messages of the previous one arrive."""
_TIMEOUT_S = 10.0
_DEFINITION = "definition"
_SPIN_ONCE = "spin_once"

Operation = Callable[[], Awaitable[object]]


class Recorder:
    """Recorder of the calls of one thread; `with` records them."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        """Calls in order, each as ``file:line function``."""

    @property
    def files(self) -> int:
        """Number of files with the called functions."""
        return len({call.partition(":")[0] for call in self.calls})

    def _on_event(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(_PACKAGE):
            name = getattr(code, "co_qualname", code.co_name)
            self.calls.append(f"{code.co_filename.removeprefix(_PACKAGE)}:{code.co_firstlineno} {name}")

    def __enter__(self) -> Recorder:
        sys.setprofile(self._on_event)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)


async def _do_nothing() -> None:
    pass


async def measure(operation: Operation, before: Operation = _do_nothing, after: Operation = _do_nothing) -> Recorder:
    """Return the calls of an operation when it is warm; `before` and `after` are called around it, not counted."""
    results = []
    for number in range(_WARM_UP + _MEASUREMENTS):
        if number >= _WARM_UP:
            await asyncio.sleep(_SETTLE_S)
        await before()
        with Recorder() as recorder:
            await operation()
        await after()
        results.append(recorder)
    return min(results[_WARM_UP:], key=lambda recorder: len(recorder.calls))


class Pair:
    """Two nodes in contexts of their own, with an endpoint of each kind; each method is one operation."""

    def __init__(self, one: Node, other: Node) -> None:
        self._string, self._add = get_message("std_msgs/msg/String"), get_service("example_interfaces/srv/AddTwoInts")
        self._fibonacci = fibonacci = get_action("example_interfaces/action/Fibonacci")
        self._one, self._other = one, other
        self._publisher = one.create_publisher(self._string, "chatter")
        self._received = asyncio.Event()
        other.create_subscription(self._string, "chatter", lambda _: self._received.set())
        other.create_service(self._add, "add", lambda request: self._add.Response(sum=request.a + request.b))
        self._client = one.create_client(self._add, "add")

        async def execute(_: object) -> object:
            return fibonacci.Result(sequence=[0, 1])

        other.create_action_server(fibonacci, "fibonacci", execute)
        self._actions = one.create_action_client(fibonacci, "fibonacci")
        other.declare_parameter("speed", 1.0)
        self._parameters = one.create_parameter_client("other")

    async def wait(self) -> None:
        """Wait until the endpoints are matched."""
        await self._publisher.wait_for_subscribers(_TIMEOUT_S)
        await self._client.wait_for_service(_TIMEOUT_S)
        await self._actions.wait_for_server(_TIMEOUT_S)

    async def publish(self) -> None:
        self._received.clear()
        self._publisher.publish(self._string(data="hello"))

    async def receive(self) -> None:
        await self._received.wait()

    async def call(self) -> None:
        await self._client.call(self._add.Request(a=1, b=2), _TIMEOUT_S)

    async def run_goal(self) -> None:
        goal: Any = await self._actions.send_goal(self._fibonacci.Goal(order=2), _TIMEOUT_S)
        await goal.result(_TIMEOUT_S)

    async def change_graph(self) -> None:
        self._other.create_publisher(self._string, "change").close()
        await asyncio.sleep(_SETTLE_S)

    async def set_parameter(self) -> None:
        self._other.set_parameters({"speed": 2.0})

    async def set_remote_parameter(self) -> None:
        await self._parameters.set({"speed": 2.0}, timeout_s=_TIMEOUT_S)


@asynccontextmanager
async def connected_pair(domain_id: int) -> AsyncIterator[Pair]:
    """Return a `Pair` on DDS whose endpoints are matched."""
    async with Context(domain_id=domain_id) as context, Context(domain_id=domain_id) as other_context:
        pair = Pair(Node("one", context=context), Node("other", context=other_context))
        await pair.wait()
        await asyncio.sleep(1.0)  # until the nodes are announced, too
        yield pair


OPERATIONS: dict[str, Callable[[Pair], Awaitable[Recorder]]] = {
    "publish": lambda pair: measure(pair.publish, after=pair.receive),
    "receive": lambda pair: measure(pair.receive, before=pair.publish),
    "service": lambda pair: measure(pair.call),
    "goal": lambda pair: measure(pair.run_goal),
    "goal after a change": lambda pair: measure(pair.run_goal, before=pair.change_graph),
    "parameter": lambda pair: measure(pair.set_parameter),
    "remote parameter": lambda pair: measure(pair.set_remote_parameter),
}
"""Operations on an event loop by name."""


async def count(names: Iterable[str], domain_id: int) -> dict[str, Recorder]:
    """Return the calls of operations on an event loop."""
    async with connected_pair(domain_id) as pair:
        return {name: await OPERATIONS[name](pair) for name in names}


def compile_message(number: int) -> Recorder:
    """Return the calls of compiling one definition of a message."""
    with Recorder() as recorder:
        compile_definition(f"calls/msg/Message{number}", "float64 x\nstring name\nint32[] values\n")
    return recorder


def spin_once(domain_id: int) -> Recorder:
    """Return the calls of rclpy's `spin_once` with one message for a callback."""
    for name in [name for name in sys.modules if name.startswith("std_msgs")]:
        del sys.modules[name]  # imported with the other API
    install_import_hook(message_api="rclpy", override_installed=True)
    import rclpy
    from std_msgs.msg import String

    results = []
    rclpy.init(domain_id=domain_id)
    node = rclpy.create_node("one")
    publisher = node.create_publisher(String, "chatter", 10)
    node.create_subscription(String, "chatter", lambda _: None, 10)
    for _ in range(_WARM_UP + _MEASUREMENTS):
        publisher.publish(String(data="hello"))
        time.sleep(_SETTLE_S)
        with Recorder() as recorder:
            rclpy.spin_once(node, timeout_sec=_TIMEOUT_S)
        results.append(recorder)
    rclpy.shutdown()
    return min(results[_WARM_UP:], key=lambda one: len(one.calls))


def count_all(names: Collection[str], domain_id: int) -> dict[str, Recorder]:
    """Return the calls of the operations with these names."""
    on_loop = [name for name in names if name in OPERATIONS]
    counts: dict[str, Recorder] = run(lambda: count(on_loop, domain_id)) if on_loop else {}
    if _DEFINITION in names:
        counts[_DEFINITION] = [compile_message(number) for number in range(_WARM_UP)][-1]
    if _SPIN_ONCE in names:
        counts[_SPIN_ONCE] = spin_once(domain_id)
    return counts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    every = (*OPERATIONS, _DEFINITION, _SPIN_ONCE)
    parser.add_argument("names", nargs="*", choices=[*every, []], metavar="NAME", help=f"of: {', '.join(every)}")
    parser.add_argument("--list", action="store_true", help="print the calls, too")
    parser.add_argument("--domain-id", type=int, default=_DOMAIN_ID, help="DDS domain")
    arguments = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.pop("CYCLONEDDS_URI", None)
    for name, recorder in count_all(arguments.names or every, arguments.domain_id).items():
        print(f"{name:<20}{len(recorder.calls):>5} calls in {recorder.files} files")
        for call in recorder.calls if arguments.list else ():
            print(f"    {call}")


if __name__ == "__main__":
    main()
