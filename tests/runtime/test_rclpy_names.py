"""Names of rclpy work where they mean the same, else the error says what ours is called; and what a `repr` says."""

from __future__ import annotations

import ast
import asyncio
import importlib
import inspect
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from example_interfaces.action import Fibonacci
from std_msgs.msg import String
from std_srvs.srv import SetBool
from support.node_fixtures import GENERATED, ROOT, World, until

from rosidl_py_gen import runtime
from rosidl_py_gen.base import rclpy_names
from rosidl_py_gen.runtime import Context, LifecycleNode, MemoryTransport, Node, ServerGoal, qos

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

MIGRATION = (ROOT / "docs" / "migration.md").read_text(encoding="utf-8")
CLASSES = {
    name: getattr(runtime, name, None) or importlib.import_module("rosidl_py_gen.runtime.logs.loggers").RosLogger
    for name in rclpy_names.ATTRIBUTES
}


@pytest.fixture
def node() -> Iterator[Any]:
    with Context(0, transport=MemoryTransport(), args=["test"]) as context:
        yield Node("n", "ns", context=context)


async def owners(node: Node) -> dict[str, Any]:
    """One object of every class in the table, made as people do who know rclpy."""
    execute = Execute()
    made: dict[str, Any] = {
        "Node": node,
        "Context": node.context,
        "RosLogger": node.logger,
        "Publisher": node.create_publisher(String, "t", 10),
        "Subscription": node.create_subscription(String, "t", lambda message: None, 10),
        "ServiceServer": node.create_service(SetBool, "s", lambda request: SetBool.Response()),
        "Client": node.create_client(SetBool, "s"),
        "Timer": node.create_timer(1.0, lambda: None),
        "Rate": node.create_rate(10),
        "ActionServer": node.create_action_server(Fibonacci, "a", execute),
        "ActionClient": node.create_action_client(Fibonacci, "a"),
    }
    made["ClientGoal"] = await made["ActionClient"].send_goal(Fibonacci.Goal(), timeout_s=5)
    await execute.began.wait()
    made["ServerGoal"] = execute.goal
    return made


class Execute:
    def __init__(self) -> None:
        self.began = asyncio.Event()
        self.goal: ServerGoal[Fibonacci] | None = None

    async def __call__(self, goal: ServerGoal[Fibonacci]) -> Fibonacci.Result:
        self.goal = goal
        self.began.set()
        await goal.wait_for_cancel()
        return Fibonacci.Result()


async def test_every_name_of_the_table_works_or_says_what_is_ours(node: Any) -> None:
    made = await owners(node)
    assert set(made) == set(rclpy_names.ATTRIBUTES)
    for kind, names in rclpy_names.ATTRIBUTES.items():
        assert type(made[kind]).__name__ == kind
        for name, answer in names.items():
            assert isinstance(inspect.getattr_static(made[kind], name), rclpy_names.Foreign), f"{kind}.{name} is ours"
            if isinstance(answer, str):
                with pytest.raises(AttributeError) as caught:
                    getattr(made[kind], name)
                assert (
                    str(caught.value) == f"{kind!r} object has no attribute {name!r}, which is rclpy's; here: {answer}"
                )
            else:
                getattr(made[kind], name)


def ours() -> set[str]:
    """Every public name of the runtime and of what its classes have."""
    found = set(runtime.__all__)
    for name in runtime.__all__:
        found |= set(dir(getattr(runtime, name)))
        if inspect.isclass(cls := getattr(runtime, name)):
            found |= set(inspect.signature(cls.__init__).parameters)
    found |= set(vars(qos)) | {"node", "publisher", "subscription", "timer", "service", "qos", "period_s", "asyncio"}
    return found


def words_of_code(text: str) -> set[str]:
    """What a sentence calls: names in front of a bracket, behind a dot, and keyword arguments."""
    return {word for part in text.replace("(", "( ").split() for word in _called(part)}


def _called(part: str) -> list[str]:
    stem = part.split("(")[0].rstrip(",:;")
    return [word for word in stem.split(".") if word.isidentifier()] if "(" in part or "." in stem[1:] else []


FOREIGN = {"asyncio", "Event", "loop", "call_soon_threadsafe", "Future", "Lock", "create_task", "cancel", "client"}
VARIABLES = {"context", "request", "parameter", "task", "rosidl_py_gen", "runtime", "sys", "argv", "value", "goal"}


def test_what_the_errors_name_exists() -> None:
    known = ours() | FOREIGN | VARIABLES
    for cls in map(CLASSES.get, rclpy_names.ATTRIBUTES):
        known |= set(dir(cls))
    texts = [text for names in rclpy_names.ATTRIBUTES.values() for text in names.values() if isinstance(text, str)]
    for text in (*texts, *rclpy_names.MODULE.values()):
        assert words_of_code(text) - known == set(), text


def test_every_name_of_the_table_stands_in_the_guide_of_migration() -> None:
    section = MIGRATION.partition("## Names that you may type")[2].partition("\n## ")[0]
    rows = {line.split("`")[1]: line for line in section.splitlines() if line.startswith("| `")}
    for kind, names in rclpy_names.ATTRIBUTES.items():
        listed = rows[kind]
        missing = {name for name in names if f"`{name}`" not in listed}
        assert missing == set(), f"{kind}: {missing}"
    for name in (*rclpy_names.MODULE, *rclpy_names.KEYWORDS):
        assert f"`{name}`" in section or f"`{name}=`" in section, name


@pytest.mark.every_transport
async def test_a_script_written_for_rclpy_goes_a_long_way(world: World) -> None:
    node: Any = world.node("minimal")
    heard: list[Any] = []
    publisher = node.create_publisher(String, "topic", 10)
    subscription = node.create_subscription(String, "topic", heard.append, 10)
    node.declare_parameter("speed", 1.5)
    assert node.get_parameter("speed") == 1.5
    assert (node.get_name(), node.get_namespace(), node.get_fully_qualified_name()) == ("minimal", "/", "/minimal")
    assert node.get_logger() is node.logger and node.get_clock().now().nanoseconds > 0
    await until(lambda: publisher.get_subscription_count() == 1 and subscription.get_publisher_count() == 1)
    publisher.publish(String(data="x"))
    await until(lambda: [message.data for message in heard] == ["x"])
    assert publisher.topic_name == "/topic" and publisher.qos_profile.depth == 10
    timer = node.create_timer(0.5, lambda: None)
    assert node.destroy_timer(timer) is True and node.destroy_publisher(publisher) is True
    subscription.destroy()
    client = node.create_client(SetBool, "s")
    assert client.srv_name == "/s" and client.service_is_ready() is False
    node.destroy_node()
    assert node.is_closed


async def test_an_action_handler_of_rclpy_works_unchanged(world: World) -> None:
    def execute(goal_handle: Any) -> Any:
        sequence = [0, 1]
        for _ in range(goal_handle.request.order - 1):
            if goal_handle.is_cancel_requested:
                goal_handle.canceled()
                return Fibonacci.Result(sequence=sequence)
            sequence.append(sequence[-2] + sequence[-1])
            goal_handle.publish_feedback(Fibonacci.Feedback(sequence=sequence))
        goal_handle.succeed()
        return Fibonacci.Result(sequence=sequence)

    world.node("server").create_action_server(Fibonacci, "fib", execute)
    client = world.node("client").create_action_client(Fibonacci, "fib")
    goal = await client.send_goal(Fibonacci.Goal(order=4), timeout_s=10)
    status, answer = await goal.result(timeout_s=10)
    assert (status.name, list(answer.sequence)) == ("SUCCEEDED", [0, 1, 1, 2, 3])


def test_keywords_of_rclpy_are_refused_with_ours(node: Any) -> None:
    tries: dict[str, Any] = {
        "here: qos": lambda: node.create_publisher(String, "t", qos_profile=10),
        "here: no callback groups": lambda: node.create_subscription(String, "t", print, 10, callback_group=None),
        "here: timeout_s": lambda: node.create_client(SetBool, "s").wait_for_service(timeout_sec=1.0),
        "here: name": lambda: node.create_service(SetBool, srv_name="s"),
        "here: handler": lambda: node.create_service(SetBool, "s", callback=print),
        "here: period_s": lambda: node.create_timer(timer_period_sec=1.0, callback=print),
        "here: default": lambda: node.declare_parameter("p", value=1),
        "here: execute": lambda: node.create_action_server(Fibonacci, "a", execute_callback=print),
        "here: async for feedback": lambda: node.create_action_client(Fibonacci, "a").send_goal(1, feedback_callback=1),
        "here: overrides": lambda: Node("m", context=node.context, parameter_overrides=[]),  # type: ignore[call-arg]
        "here: throttle_s": lambda: node.logger.info("x", throttle_duration_sec=1.0),
        "here: on_clock_change": lambda: node.clock.create_jump_callback(threshold=None, post_callback=print),
    }
    for text, attempt in tries.items():
        with pytest.raises(TypeError, match=text):
            attempt()
    for wrong in (lambda: node.create_publisher(String, "t", nonsense=1), lambda: node.logger.info("x", nonsense=1)):
        with pytest.raises(TypeError, match="unexpected keyword argument 'nonsense'"):
            wrong()


def test_another_unknown_name_stays_what_it_is_for_python(node: Any) -> None:
    with pytest.raises(AttributeError, match=r"'Node' object has no attribute 'nonsense'$"):
        _ = node.nonsense
    assert not hasattr(node, "spin_once") and getattr(node, "executor", None) is None

    class Mine(LifecycleNode):
        @property
        def broken(self) -> int:
            return self.not_there  # type: ignore[no-any-return,attr-defined]

    with pytest.raises(AttributeError, match="not_there"):
        _ = Mine("m", context=node.context).broken


def test_names_of_the_module_say_what_is_ours_also_when_imported() -> None:
    for name, answer in rclpy_names.MODULE.items():
        assert name not in runtime.__all__
        with pytest.raises(AttributeError) as caught:
            getattr(runtime, name)
        assert str(caught.value).endswith(f"here: {answer}") and not hasattr(runtime, name)
    with pytest.raises(ImportError, match="here: await what you wait for"):
        from rosidl_py_gen.runtime import spin_once  # type: ignore[attr-defined]  # noqa: F401


def test_type_checkers_still_report_every_name(tmp_path: Path) -> None:
    program = "from rosidl_py_gen import runtime\nfrom rosidl_py_gen.runtime import " + ", ".join(
        sorted(name for name in rclpy_names.ATTRIBUTES if name != "RosLogger")
    )
    names = [(kind, name) for kind, of in rclpy_names.ATTRIBUTES.items() if kind != "RosLogger" for name in of]
    generic = {"Publisher": "[int]", "Subscription": "[int]", "Client": "[int, int]", "ServiceServer": "[int, int]"}
    generic |= dict.fromkeys(("ActionClient", "ActionServer", "ClientGoal", "ServerGoal"), "[int]")
    lines = [f"def f{i}(x: {kind}{generic.get(kind, '')}) -> None: x.{name}" for i, (kind, name) in enumerate(names)]
    (tmp_path / "program.py").write_text("\n".join([program, *lines, "runtime.init"]))
    result = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-strict-optional", "--cache-dir", str(tmp_path / "c"), "program.py"],
        cwd=tmp_path,
        env={"PATH": "/usr/bin", "MYPYPATH": GENERATED.name},
        capture_output=True,
        text=True,
        check=False,
    )
    unknown = [line for line in result.stdout.splitlines() if "[attr-defined]" in line]
    assert len(unknown) >= len(names) + 1, result.stdout + result.stderr
    assert ast.parse(program)


async def test_a_repr_says_name_type_quality_of_service_and_peers(world: World) -> None:
    node = world.node("shown")
    publisher = node.create_publisher(String, "t", qos.SENSOR_DATA)
    subscription = node.create_subscription(String, "t", print, qos.SENSOR_DATA)
    server = node.create_service(SetBool, "s", lambda request: SetBool.Response())
    client = node.create_client(SetBool, "s")
    actions = node.create_action_server(Fibonacci, "a", lambda goal: Fibonacci.Result())
    action_client = node.create_action_client(Fibonacci, "a")
    timer = node.create_wall_timer(60.0, lambda: None)
    assert await client.wait_for_service(10) and await action_client.wait_for_server(10)
    profile = "best effort, volatile, keep last 5"
    service = "reliable, volatile, keep all"
    await until(lambda: "1 sub" in repr(publisher) and "1 pub" in repr(subscription) and "1 client" in repr(actions))
    await until(lambda: "1 client" in repr(server))
    assert repr(publisher) == f"Publisher(/t, std_msgs/msg/String, {profile}, 1 subscription)"
    assert repr(subscription) == f"Subscription(/t, std_msgs/msg/String, {profile}, 1 publisher)"
    assert repr(server) == f"ServiceServer(/s, std_srvs/srv/SetBool, {service}, 1 client)"
    assert repr(client) == f"Client(/s, std_srvs/srv/SetBool, {service}, 1 server)"
    assert repr(actions) == "ActionServer(/a, example_interfaces/action/Fibonacci, 0 active goals, 1 client)"
    assert repr(action_client) == "ActionClient(/a, example_interfaces/action/Fibonacci, 1 server)"
    assert repr(timer) == "Timer(60 s, STEADY_TIME, 0 calls)"
    timer.cancel()
    assert repr(timer) == "Timer(60 s, STEADY_TIME, canceled, 0 calls)"
    assert repr(node).startswith("Node(/shown, domain ") and repr(node).endswith(" other nodes)")
    node.close()
    for closed in (publisher, subscription, server, client, actions, action_client, timer, node):
        assert repr(closed).endswith(", closed)")
