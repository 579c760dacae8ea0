"""ROS loggers: names, levels, call-site options, console lines and the fields for /rosout.

Source: docs/internals/protocol.md 9.7.
"""

from __future__ import annotations

import logging as python_logging
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest
from support.worlds import World

from rosidl_py_gen import runtime
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.msgs.rcl_interfaces.msg import Log
from rosidl_py_gen.runtime import logs
from rosidl_py_gen.runtime.clocks import Clock
from rosidl_py_gen.runtime.logs import (
    DEBUG,
    ERROR,
    FATAL,
    INFO,
    UNSET,
    WARN,
    ConsoleSettings,
    LogLevelError,
    RosLogger,
    RosoutRouter,
    format_record,
    get_logger,
    get_logger_level,
    get_root_logger,
    logger_name,
    message_text,
    node_logger,
    ros_level,
    set_logger_level,
    shared_router,
)
from rosidl_py_gen.runtime.node.node import log_message
from rosidl_py_gen.runtime.parameters.store import ParameterStore
from rosidl_py_gen.runtime.parameters.values import parameter_value
from rosidl_py_gen.runtime.transport.qos import ROSOUT


class Catcher(python_logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.records: list[python_logging.LogRecord] = []

    def emit(self, record: python_logging.LogRecord) -> None:
        self.records.append(record)


@pytest.fixture
def caught() -> Iterator[list[python_logging.LogRecord]]:
    handler = Catcher()
    get_root_logger().addHandler(handler)
    yield handler.records
    get_root_logger().removeHandler(handler)


@pytest.mark.parametrize(("fqn", "name"), [("/a/b/n", "a.b.n"), ("/n", "n")])
def test_logger_names_are_node_names_with_dots(fqn: str, name: str) -> None:
    assert logger_name(fqn) == name and node_logger(fqn) is get_logger(name)
    with pytest.raises(InvalidNameError):
        node_logger("/a/1")


def test_get_logger_returns_ros_loggers_without_a_node() -> None:
    assert runtime.get_logger("a.b") is get_logger("a").get_child("b")
    assert runtime.get_logger("").get_child("a") is get_logger("a")
    assert isinstance(get_logger("a.b"), RosLogger) and get_logger("") is get_root_logger()
    assert get_logger("asyncio") is not python_logging.getLogger("asyncio")


def test_python_levels_are_rounded_down_to_ros_levels() -> None:
    assert [ros_level(n) for n in (1, 10, 15, 25, 39, 50, 99)] == [10, 10, 10, 20, 30, 50, 50]


def test_logger_level_is_inherited_from_nearest_ancestor_with_info_as_default() -> None:
    assert get_logger("lv.a.b").getEffectiveLevel() == INFO and get_logger_level("lv.a.b") == UNSET
    set_logger_level("lv", "error")
    runtime.set_logger_level("lv.a", "Debug")
    assert runtime.get_logger_level("lv.a") == DEBUG
    levels = [get_logger(name).getEffectiveLevel() for name in ("lv.a.b", "lv.x", "lvx")]
    assert levels == [DEBUG, ERROR, INFO]
    assert get_logger("lv.a.b").isEnabledFor(DEBUG)
    set_logger_level("lv.a", UNSET)
    assert get_logger("lv.a.b").getEffectiveLevel() == ERROR and not get_logger("lv.a.b").isEnabledFor(INFO)
    set_logger_level("lv", "unset")


def test_unsetting_the_root_logger_level_restores_info() -> None:
    set_logger_level("", WARN)
    assert get_logger("anything").getEffectiveLevel() == WARN
    set_logger_level("", UNSET)
    assert get_logger("anything").getEffectiveLevel() == INFO


def test_every_level_has_a_method_that_records_the_call_site(caught: list[python_logging.LogRecord]) -> None:
    logger = get_logger("sites")
    line = sys._getframe().f_lineno
    logger.info("a %d", 1)
    logger.warning("b")
    logger.warn("c")
    logger.error("d")
    logger.fatal("e")
    logger.critical("f")
    logger.log(WARN, "g")
    logger.debug("not enabled")
    logger.get_child("kid").info("h")
    assert [(r.levelno, r.getMessage(), r.lineno - line) for r in caught] == [
        (INFO, "a 1", 1),
        (WARN, "b", 2),
        (WARN, "c", 3),
        (ERROR, "d", 4),
        (FATAL, "e", 5),
        (FATAL, "f", 6),
        (WARN, "g", 7),
        (INFO, "h", 9),
    ]
    assert {r.pathname for r in caught} == {__file__} and caught[-1].name == "sites.kid"
    assert {r.funcName for r in caught} == {"test_every_level_has_a_method_that_records_the_call_site"}


def test_stacklevel_applies_once_and_call_site_to_callers_of_a_wrapper(caught: list[python_logging.LogRecord]) -> None:
    def wrapped(text: str) -> None:
        get_logger("wrapped").info(text, once=True, stacklevel=2, stack_info=True)

    for _ in range(2):
        wrapped("a")
        wrapped("b")
    found = [(r.getMessage(), r.funcName) for r in caught]
    assert found == [(text, "test_stacklevel_applies_once_and_call_site_to_callers_of_a_wrapper") for text in "ab"]
    assert caught[0].stack_info is not None and "in wrapped" not in caught[0].stack_info


@pytest.mark.parametrize("name", [None, 5, b"a", ["a"]])
def test_logger_name_must_be_a_string(name: Any) -> None:
    for use in (get_logger, get_logger_level, lambda name: set_logger_level(name, INFO)):
        with pytest.raises(TypeError, match="the name of a logger must be a str, got "):
            use(name)


@pytest.mark.parametrize("level", [None, 25, 20.0, [], "loud"])
def test_unknown_log_level_is_refused(level: Any) -> None:
    with pytest.raises(LogLevelError, match="unknown log level"):
        set_logger_level("x", level)


def test_exception_logs_the_traceback(caught: list[python_logging.LogRecord]) -> None:
    try:
        raise RuntimeError("boom")
    except RuntimeError:
        get_logger("exc").exception("failed")
    text = message_text(caught[0])
    assert caught[0].levelno == ERROR and text.startswith("failed\nTraceback") and text.endswith("boom")


def test_once_skip_first_and_throttle_are_counted_per_call_site(caught: list[python_logging.LogRecord]) -> None:
    logger = get_logger("once")
    for i in range(3):
        logger.info("once %d", i, once=True)
        logger.info("skip %d", i, skip_first=True)
        logger.info("throttle %d", i, throttle_s=60)
    assert [r.getMessage() for r in caught] == ["once 0", "throttle 0", "skip 1", "skip 2"]


def test_once_is_not_consumed_while_the_level_is_disabled(caught: list[python_logging.LogRecord]) -> None:
    logger = get_logger("later")
    for level in (ERROR, INFO, INFO):
        set_logger_level("later", level)
        logger.info("now", once=True)
    assert len(caught) == 1


def test_throttle_logs_one_message_per_period(
    caught: list[python_logging.LogRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    for now_s in (0.0, 0.5, 0.99, 1.0, 1.5, 2.1):
        monkeypatch.setattr(time, "monotonic", lambda now_s=now_s: now_s)
        get_logger("throttled").info("%s", now_s, throttle_s=1.0)
    assert [r.getMessage() for r in caught] == ["0.0", "1.0", "2.1"]


def record(level: int = WARN, msg: str = "hi", name: str = "a.n") -> python_logging.LogRecord:
    log_record = python_logging.LogRecord(name, level, "/src/f.py", 12, msg, (), None, "main")
    log_record.created = 3.25
    return log_record


def test_console_format_tokens_are_replaced() -> None:
    text = "{time_as_nanoseconds} {file_name}:{line_number} {function_name} {severity} {nope} {message}"
    assert format_record(record(msg="{name}"), text) == "3250000000 /src/f.py:12 main WARN {nope} {name}"
    assert format_record(record(), "{date_time_with_ms}").endswith(".250")


FORMAT = {"CONSOLE_OUTPUT_FORMAT": "{severity} {name}: {message}"}
COLORED = {"CONSOLE_OUTPUT_FORMAT": "{message}", "COLORIZED_OUTPUT": "1"}


@pytest.mark.parametrize(
    ("environ", "level", "out", "err"),
    [
        (FORMAT, WARN, "", "WARN a: hi\n"),
        ({**FORMAT, "LOGGING_USE_STDOUT": "1"}, WARN, "WARN a: hi\n", ""),
        ({**COLORED, "COLORIZED_OUTPUT": "0"}, WARN, "", "hi\n"),
        (COLORED, WARN, "", "\x1b[33mhi\x1b[0m\n"),
        (COLORED, ERROR, "", "\x1b[31mhi\x1b[0m\n"),
        (COLORED, INFO, "", "hi\n"),
    ],
)
def test_print_logs_follows_environment_without_a_context(
    environ: dict[str, str],
    level: int,
    out: str,
    err: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(python_logging.getLogger(), "handlers", [])
    monkeypatch.setattr(get_root_logger(), "handlers", [])
    monkeypatch.setattr(logs.console_handler, "settings", ConsoleSettings())
    for name, value in environ.items():
        monkeypatch.setenv(f"RCUTILS_{name}", value)
    get_logger("a").info("not yet")
    runtime.print_logs()
    runtime.print_logs()
    get_logger("a").log(level, "hi")
    assert capsys.readouterr() == (out, err)


def test_console_is_quiet_when_python_handlers_receive_the_records(
    caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    logs.install_console(ConsoleSettings())
    get_logger("seen").info("by caplog")
    assert "by caplog" in caplog.text and capsys.readouterr().err == ""


def test_log_message_has_the_fields_of_its_record() -> None:
    message = Log(level=WARN, name="a.n", msg="hi", file="/src/f.py", function="main", line=12)
    message.stamp.sec, message.stamp.nanosec = 3, 250_000_000
    assert log_message(record()) == message


def test_rosout_records_are_routed_to_oldest_node_of_nearest_logger() -> None:
    received: list[tuple[str, str]] = []

    def publish_as(node: str) -> Any:
        return lambda fields: received.append((node, fields.name))

    router = RosoutRouter()
    router.register("a", publish_as("parent"))
    added = router.register("a.n", publish_as("child"))
    router.register("a.n", publish_as("of the same name"))
    for name in ("a", "a.b", "a.n", "a.n.kid", "ax", "other"):
        router.emit(record(name=name))
    assert received == [("parent", "a"), ("parent", "a.b"), ("child", "a.n"), ("child", "a.n.kid")]
    added.close()
    added.close()
    router.emit(record(name="a.n"))
    assert received[-1] == ("of the same name", "a.n")


def test_logging_inside_rosout_publishing_is_not_published_again() -> None:
    seen: list[str] = []

    def publish(record: python_logging.LogRecord) -> None:
        seen.append(record.getMessage())
        get_logger("routed").warning("again")

    with shared_router().register("routed", publish):
        get_logger("routed.kid").warning("x")
    get_logger("routed").warning("y")
    assert seen == ["x"]


# -------------------------------------------------------------------------------- failures with and without a node


def broken_clock(**options: Any) -> Clock:
    clock = Clock(**options)
    clock.create_jump_callback(pre=fail, on_clock_change=True)
    return clock


def fail(*_: object) -> None:
    raise RuntimeError("boom")


@pytest.mark.parametrize("switch", ["fatal", "rosidl_py_gen:=fatal"])
def test_log_level_silences_failures_without_a_node(
    memory: World, switch: str, caught: list[python_logging.LogRecord]
) -> None:
    broken_clock().enable_ros_time_override()
    memory.context(f"--ros-args --log-level {switch}")
    broken_clock().enable_ros_time_override()
    for name in ("", "rosidl_py_gen"):
        set_logger_level(name, UNSET)
    (failure,) = caught
    assert (failure.name, failure.levelno) == ("rosidl_py_gen", ERROR)
    assert failure.getMessage() == "a time jump callback failed; nothing else is affected"


def test_failures_of_parameter_store_without_node_are_logged_by_package_logger(
    caught: list[python_logging.LogRecord],
) -> None:
    store = ParameterStore()
    store.callbacks.add("post-set", fail)
    store.declare("a", parameter_value(1))
    assert [one.name for one in caught] == ["rosidl_py_gen"] and "boom" in message_text(caught[0])


async def test_callback_failure_is_published_on_rosout_by_its_own_node_only(world: World) -> None:
    alice, bob = world.pair()
    logs = bob.create_subscription(Log, "/rosout", qos=ROSOUT)
    broken_clock().enable_ros_time_override()
    alice.clock.create_jump_callback(post=fail, on_clock_change=True)
    alice.clock.enable_ros_time_override()
    bob.logger.warning("the last")
    received = [await logs.receive(5), await logs.receive(5)]
    assert sorted(log.name for log in received) == ["alice", "bob"]
    assert any(log.msg.startswith("a time jump callback failed") and "boom" in log.msg for log in received)
