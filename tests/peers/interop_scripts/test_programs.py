"""Programs of rclpy users behave the same under this rclpy and the real one."""

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

CHANGE, CLOCK = "lifecycle_msgs/srv/ChangeState", "rosgraph_msgs/msg/Clock"
STRING, INT, SET = "std_msgs/msg/String", "std_msgs/msg/Int32", "std_srvs/srv/SetBool"


def strings(*texts: str) -> tuple[dict[str, str], ...]:
    return tuple({"data": text} for text in texts)


def seconds(start: int, end: int) -> tuple[dict[str, dict[str, int]], ...]:
    return tuple({"clock": {"sec": second}} for second in range(start, end))


SET_PARAMETERS = "rcl_interfaces/srv/SetParameters"
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
        "--ros-args -r chatter:=news -r __ns:=/ns -r __node:=other",
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
    Case(
        "parameters",
        (
            Parameters("/configured"),
            Call("/configured/set_parameters", SET_PARAMETERS, CHANGES),
            Parameters("/configured"),
            Interrupt(),
        ),
        "--ros-args -p rate:=2.5 -p 'names:=[a, b]'",
    ),
    Case("latched", (Receive("/map", STRING, 1, LATCHED), Graph(), Interrupt())),
    Case("exceptions", (Publish("/in", INT, ({"data": 1}, {"data": 0})),)),
    Case("threads", (Receive("/count", INT, 3), Interrupt()), unordered=True),
    Case("async_callbacks", (Call("/double", SET, {"data": True}), Interrupt())),
    Case("without_init"),
    Case(
        "lamp",
        (
            Graph(),
            *(
                Call("/lc_talker/change_state", CHANGE, {"transition": {"id": 0, "label": label}})
                for label in ("activate", "configure", "activate")
            ),
            Receive("/lifecycle_chatter", STRING, 2),
            Printed("#1"),
            Call("/lc_talker/get_state", "lifecycle_msgs/srv/GetState"),
            Call("/lc_talker/get_available_transitions", "lifecycle_msgs/srv/GetAvailableTransitions"),
            Call("/lc_talker/get_available_states", "lifecycle_msgs/srv/GetAvailableStates"),
            Call("/lc_talker/change_state", CHANGE, {"transition": {"id": 4}}),
            Call("/lc_talker/change_state", CHANGE, {"transition": {"label": "cleanup"}}),
            Call("/lc_talker/get_state", "lifecycle_msgs/srv/GetState"),
            Call("/lc_talker/change_state", CHANGE, {"transition": {"label": "shutdown"}}),
            Interrupt(),
        ),
    ),
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
        "sim_time",
        (Publish("/clock", CLOCK, ()), Printed("ready"), Publish("/clock", CLOCK, seconds(10, 17))),
        "--ros-args -p use_sim_time:=true",
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
def test_program_behaves_the_same_under_both_rclpys(case: Case, observed: Observed) -> None:
    if different := difference(case, *observed(case)):
        pytest.fail(different, pytrace=False)
