"""Programs in the ways rclpy's users write them: under our rclpy they do what they do under the real one."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest
from two_rclpys import (
    PROGRAMS,
    Call,
    Case,
    Graph,
    Interrupt,
    Observer,
    Parameters,
    Printed,
    Publish,
    Receive,
    difference,
)
from worlds import World, domain_id

from rosidl_py_gen.runtime import QoSProfile

STRING, INT, SET = "std_msgs/msg/String", "std_msgs/msg/Int32", "std_srvs/srv/SetBool"


def strings(*texts: str) -> tuple[dict[str, str], ...]:
    return tuple({"data": text} for text in texts)


SET_PARAMETERS = "set_parameters", "rcl_interfaces/srv/SetParameters"
CHANGES = {
    "parameters": [
        {"name": "rate", "value": {"type": 3, "double_value": 4.0}},
        {"name": "rate", "value": {"type": 2, "integer_value": 4}},
        {"name": "limited", "value": {"type": 2, "integer_value": 99}},
        {"name": "fixed", "value": {"type": 4, "string_value": "x"}},
        {"name": "refused", "value": {"type": 1, "bool_value": True}},
    ]
}
LATCHED = QoSProfile().keep_last(10).transient_local()
CASES = [
    Case("talker", (Receive("/chatter", STRING, 4), Printed("World: 3"), Graph(), Interrupt())),
    Case(
        "talker",
        (Receive("/ns/news", STRING, 4), Printed("World: 3"), Graph(), Interrupt()),
        ("--ros-args", "-r", "chatter:=news", "-r", "__ns:=/ns", "-r", "__node:=other"),
    ),
    Case("listener", (Graph(), Publish("/chatter", STRING, strings("a", "b", "end")))),
    Case("talker", (Receive("/chatter", STRING, 4), Printed("World: 3"), Interrupt(signal.SIGTERM))),
    Case(
        "relay",
        (
            Publish("/in", INT, ({"data": 1}, {"data": 2}, {"data": 3})),
            Receive("/out", INT, 3),
            Printed("[relay]: 3"),
            Interrupt(),
        ),
    ),
    Case("add_server", (Graph(), Call("/flip", SET, {"data": True}), Call("/flip", SET, {"data": False}), Interrupt())),
    Case("call_itself", (), unordered=True),
    Case(
        "parameters",
        (
            Parameters("/configured"),
            Call(f"/configured/{SET_PARAMETERS[0]}", SET_PARAMETERS[1], CHANGES),
            Parameters("/configured"),
            Interrupt(),
        ),
        ("--ros-args", "-p", "rate:=2.5", "-p", "names:=[a, b]"),
    ),
    Case("polling", (Publish("/in", INT, tuple({"data": n} for n in range(5))), Printed("sum 10"), Graph())),
    Case("latched", (Receive("/map", STRING, 1, LATCHED), Graph(), Interrupt())),
    Case("logging_calls"),
    Case("exceptions", (Publish("/in", INT, ({"data": 1}, {"data": 0})),)),
    Case("threads", (Receive("/count", INT, 3), Interrupt()), unordered=True),
    Case("async_callbacks", (Call("/double", SET, {"data": True}), Interrupt())),
    Case("futures"),
    Case("without_init"),
]


@pytest.mark.real_time("programs are processes")
@pytest.mark.parametrize("case", CASES, ids=lambda case: "-".join((case.program, *case.arguments[2:3])))
async def test_a_program_does_the_same(case: Case, dds: World, real_python: Path, code_cache: Path) -> None:
    domain = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    program = str(PROGRAMS / f"{case.program}.py")
    real_settings = {**domain, "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
    expected = await Observer(dds, case).run([str(real_python), program], real_settings)
    dds.close()
    ours = [sys.executable, "-m", "rosidl_py_gen.tools", "run", program]
    found = await Observer(dds, case).run(ours, {**domain, "ROSIDL_PY_GEN_CACHE": str(code_cache)}, expected)
    assert not any(isinstance(one, str) and one.startswith(("nothing", "not ended")) for one in expected.seen), expected
    if different := difference(expected, found):
        pytest.fail(different, pytrace=False)
