"""Programs as users of rclpy write them do the same under our rclpy as under the real one."""

from __future__ import annotations

import signal

import pytest
from observed_programs import (
    Ask,
    Call,
    Case,
    Graph,
    Interrupt,
    Observed,
    Parameters,
    Printed,
    Publish,
    Receive,
    difference,
)

from rosidl_py_gen.runtime import QoSProfile

STRING, INT, SET = "std_msgs/msg/String", "std_msgs/msg/Int32", "std_srvs/srv/SetBool"


def strings(*texts: str) -> tuple[dict[str, str], ...]:
    return tuple({"data": text} for text in texts)


LATCHED = QoSProfile().keep_last(10).transient_local()
CASES = [
    Case("talker", (Receive("/chatter", STRING, 4), Printed("World: 3"), Graph(), Interrupt())),
    Case(
        "talker",
        (Receive("/ns/news", STRING, 4), Printed("World: 3"), Graph(), Interrupt()),
        "--ros-args -r chatter:=news -r __ns:=/ns -r __node:=other",
    ),
    Case("listener", (Graph(), Publish("/chatter", STRING, strings("a", "b", "end")))),
    Case("add_server", (Graph(), Call("/flip", SET, {"data": True}), Call("/flip", SET, {"data": False}), Interrupt())),
    Case("latched", (Receive("/map", STRING, 1, LATCHED), Graph(), Interrupt())),
    Case("exceptions", (Publish("/in", INT, ({"data": 1}, {"data": 0})),)),
    Case("threads", (Receive("/count", INT, 3), Interrupt()), unordered=True),
    Case("async_callbacks", (Call("/double", SET, {"data": True}), Interrupt())),
    Case("without_init"),
    Case(
        "parameter_files",
        (Printed("['"), Parameters("/robot/driver"), Interrupt()),
        "--ros-args --params-file programs/params.yaml -p 'more:=[1.5, 2.0]'",
    ),
    Case(
        "overrides",
        (Printed("InvalidQosOverridesError"), Graph(), Parameters("/overrides"), Interrupt()),
        "--ros-args -p qos_overrides./chatter.publisher.depth:=20"
        " -p qos_overrides./chatter.publisher.reliability:=best_effort"
        " -p qos_overrides./chatter.subscription_main.durability:=transient_local"
        " -p qos_overrides./deep.publisher.depth:=100",
    ),
    Case(
        "names",
        (Printed("/sub", 3), Graph(), Interrupt()),
        "one --ros-args -r plain:=remapped -r first:__ns:=/spaced -r first:~/private:=/public -r /absolute:=relative"
        " -- two",
    ),
    Case(
        "levels",
        (
            Printed("in spite"),
            Call(
                "/levels/get_logger_levels",
                "rcl_interfaces/srv/GetLoggerLevels",
                {"names": ["levels", "other", "third"]},
            ),
            Call(
                "/levels/set_logger_levels",
                "rcl_interfaces/srv/SetLoggerLevels",
                {"levels": [{"name": "levels", "level": 40}, {"name": "third", "level": 7}]},
            ),
            Interrupt(),
        ),
        "--ros-args --log-level warn --log-level levels:=debug --log-level other:=error",
    ),
    Case("asks_arguments", (), "x --count 3 --ros-args -p p:=5 -r __node:=n"),
    Case("asks_arguments", (), "--count many"),
    Case("loop_of_its_own", (Receive("/beat", STRING, 2), Interrupt())),
    Case("loop_of_its_own", (Receive("/beat", STRING, 2), Interrupt(signal.SIGTERM))),
    Case("uncaught", (Printed("started"), Graph(), Interrupt())),
    Case("uncaught", (Printed("started"), Interrupt(signal.SIGTERM))),
    Case("own_handlers", (Printed("started"), Interrupt())),
    Case("own_handlers", (Printed("started"), Interrupt()), "no"),
    Case("own_handlers", (Printed("started"), Interrupt()), "after"),
    Case("many_threads_stop", (Publish("/in", INT, ({"data": 1},)), Receive("/out", INT, 1), Interrupt())),
    Case(
        "many_threads_stop", (Publish("/in", INT, ({"data": 1},)), Receive("/out", INT, 1), Interrupt(signal.SIGTERM))
    ),
    Case("service_raises", (Call("/divide", SET, {"data": True}), Ask("/divide", SET, {"data": False}))),
    Case("waits_for_service", (Printed("waiting again"), Interrupt())),
    Case("waits_for_service", (Printed("waiting again"), Interrupt(signal.SIGTERM))),
    Case("fails_in_pool"),
    Case("leaves_early", leaves_threads=True),
]


@pytest.mark.real_time("programs are processes")
@pytest.mark.parametrize("case", CASES, ids=Case.name)
def test_a_program_does_the_same(case: Case, observed: Observed) -> None:
    if different := difference(case, *observed(case)):
        pytest.fail(different, pytrace=False)
