"""Our rclpy has the names of the real one, with their kinds, parameters and values; exceptions are listed here.

`tools/record_rclpy_names.py` records the one of Jazzy and describes ours in the same words.
`tools/record_lyrical_names.py` records what Lyrical has more.
docs/internals/parity.md has the same tables; if it does not, a failed test prints the expected text.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from record_lyrical_names import RECORD as LYRICAL_RECORD
from record_rclpy_names import RECORD
from support.folders import ROOT
from support.program_processes import run

PAGE = ROOT / "docs" / "internals" / "parity.md"
REAL: dict[str, dict[str, Any]] = json.loads(RECORD.read_text(encoding="utf-8"))
MISSING = {
    "functions of C handles": (
        "rclpy.clock.ClockHandle.add_clock_callback",
        "rclpy.clock.ClockHandle.remove_clock_callback",
        "rclpy.impl.implementation_singleton.import_c_library",
    ),
    "state of C logging": (
        "rclpy.context.g_logging_configure_lock",
        "rclpy.context.g_logging_ref_count",
    ),
    "the runtime serves this service, which ends with its node": (
        "rclpy.type_description_service.GetTypeDescription",
        "rclpy.type_description_service.TypeDescriptionService.destroy",
    ),
    "private imports of a module, available under their own names": (
        "rclpy.clock.TYPE_CHECKING",
        "rclpy.event_handler.rclpy",
        "rclpy.experimental.events_executor.rclpy",
        "rclpy.parameter.yaml",
        "rclpy.qos_event.rclpy",
        "rclpy.qos_overriding_options.rclpy",
        "rclpy.utilities.ament_index_python",
    ),
    "a name for type checkers inside the class": ("rclpy.exceptions.InvalidParameterTypeException.Parameter",),
}
"""Reason -> names of rclpy that ours does not have."""
MISSING_LYRICAL = {
    "types that only type checkers need": (
        "rclpy.action.client.T",
        "rclpy.event_handler.EventHandlerData",
        "rclpy.executors.T",
        "rclpy.executors.TaskData",
        "rclpy.executors.YieldedCallback",
        "rclpy.guard_condition.GuardConditionCallbackType",
        "rclpy.lifecycle.node.CallbackNames",
        "rclpy.lifecycle.node.CreateLifecyclePublisherArgs",
        "rclpy.lifecycle.node.LifecycleNodeArgs",
        "rclpy.lifecycle.node.SRV_TYPES",
        "rclpy.node.ParameterInput",
        *(
            f"rclpy.type_support.{name}"
            for name in (
                "EventMessage",
                "FeedbackMessage",
                "GetResultService",
                "GetResultServiceRequest",
                "GetResultServiceResponse",
                "SendGoalService",
                "SendGoalServiceRequest",
                "SendGoalServiceResponse",
            )
        ),
        "rclpy.waitable.T",
    ),
    "parts of the filters of loggers": tuple(
        f"rclpy.impl.rcutils_logger.{name}"
        for name in (
            "LoggingArgs",
            "LoggingFilterArgs",
            "LoggingFilterParams",
            "OnceContext",
            "RcutilsLoggerContext",
            "SkipFirstContext",
            "SupportedFiltersKeys",
            "ThrottleContext",
        )
    ),
    "parameters of constructors that only nodes call": tuple(
        f"rclpy.{name}.__init__(on_destroy)"
        for name in (
            "client.Client",
            "publisher.Publisher",
            "service.Service",
            "subscription.Subscription",
            "timer.Timer",
        )
    ),
    "the node does this": ("rclpy.context.Context.track_node", "rclpy.context.Context.untrack_node"),
    "the name of Jazzy is used": (
        "rclpy.action.server.default_cancel_callback(goal_handle)",
        "rclpy.qos.InvalidQoSProfileException.__init__(message)",
    ),
    "available in `rclpy.exceptions` and `rclpy._rclpy_pybind11`": ("rclpy.action.client.RCLError",),
}
"""Reason -> names and parameters of Lyrical's rclpy that ours does not have."""
OTHER_VALUES = {
    "an enumeration whose numbers only C code uses": tuple(
        f"rclpy.action.server.GoalEvent.{name}" for name in ("ABORT", "CANCELED", "CANCEL_GOAL", "EXECUTE", "SUCCEED")
    ),
}
"""Reason -> constants whose values differ."""
MORE = {
    "imported from `rclpy.qos`, as in Lyrical": ("rclpy.node.qos_profile_rosout_default",),
    "moved out of `rclpy.node`": ("rclpy.node_parameters",),
    "replacements of C code": (
        "rclpy.entity_execution",
        "rclpy.handles",
        "rclpy.impl.action_endpoints",
        "rclpy.impl.async_entities",
        "rclpy.impl.content_filter",
        "rclpy.impl.names",
        "rclpy.impl.pending_requests",
        "rclpy.lifecycle.node.LifecycleStateMachine",
    ),
    "replacements of C classes and functions": (
        "rclpy.clock.ClockHandle.is_valid",
        "rclpy.context.mark_all_shut_down",
        "rclpy.context.invalid_arguments_error",
        "rclpy.duration.DurationType.nanoseconds",
        "rclpy.event_handler.EventHandle",
        "rclpy.event_handler.rcl_publisher_event_type_t",
        "rclpy.event_handler.rcl_subscription_event_type_t",
        "rclpy.guard_condition.GuardConditionHandle",
        "rclpy.time.TimeHandle.clock_type",
        "rclpy.time.TimeHandle.nanoseconds",
        "rclpy.timer.TimerHandle",
        "rclpy.waitable.WaitSet",
    ),
    "attribute of all C handles except that of a clock": ("rclpy.clock.ClockHandle.pointer",),
    "type aliases": (
        "rclpy.clock.AnyClockType",
        "rclpy.time.AnyClockType",
    ),
    "a value of the middleware without a name in rclpy": ("rclpy.qos.RMW_QOS_DEADLINE_BEST_AVAILABLE",),
    "conversions of arguments": (
        "rclpy.type_support.message_class",
        "rclpy.utilities.explicit_context",
        "rclpy.utilities.resolve_context",
    ),
    "fields with a default, which rclpy sets in constructors": (
        "rclpy.clock.JumpThreshold.on_clock_change",
        *(
            f"rclpy.event_handler.PublisherEventCallbacks.{name}"
            for name in ("deadline", "incompatible_qos", "incompatible_type", "liveliness", "matched")
        ),
        "rclpy.event_handler.PublisherEventCallbacks.use_default_callbacks",
        *(
            f"rclpy.event_handler.SubscriptionEventCallbacks.{name}"
            for name in ("deadline", "incompatible_qos", "incompatible_type", "liveliness", "matched", "message_lost")
        ),
        "rclpy.event_handler.SubscriptionEventCallbacks.use_default_callbacks",
    ),
    "fields of a namedtuple, which are not recorded": tuple(
        f"rclpy.impl.rcutils_logger.CallerId.{name}"
        for name in ("file_path", "function_name", "last_index", "line_number")
    ),
}
"""Reason -> our names that begin with a letter and that rclpy of Jazzy and Lyrical does not have; no program can rely
on them.
"""


@pytest.fixture(scope="module")
def compared() -> dict[str, Any]:
    done = run(Path(__file__).with_name("compare_names.py"))
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def listed(table: dict[str, tuple[str, ...]]) -> list[str]:
    return sorted(name for names in table.values() for name in names)


def rows(table: dict[str, tuple[str, ...]]) -> str:
    """Return a table in the form of the page."""
    return "".join(f"| {', '.join(f'`{name}`' for name in names)} | {reason} |\n" for reason, names in table.items())


def test_differences_from_real_rclpy_are_listed(compared: dict[str, Any]) -> None:
    different = compared["different"]
    assert sorted(path for path, what, _ in different if what == "missing") == listed(MISSING)
    assert sorted(path for path, what, _ in different if what == "value") == listed(OTHER_VALUES)
    assert [one for one in different if one[1] not in ("missing", "value")] == []


@pytest.mark.skipif(sys.version_info < (3, 11), reason="asyncio nodes need Python 3.11")
def test_additional_names_of_lyrical_exist_or_are_listed_as_missing(compared: dict[str, Any]) -> None:
    assert sorted(path for path, _ in compared["lyrical"]) == listed(MISSING_LYRICAL)


def test_additional_names_of_this_rclpy_are_listed(compared: dict[str, Any]) -> None:
    assert sorted(compared["more"]) == listed(MORE)


TABLES = {"missing": MISSING, "values": OTHER_VALUES, "more": MORE, "lyrical": MISSING_LYRICAL}


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_parity_page_contains_tables_of_differences(table: dict[str, tuple[str, ...]]) -> None:
    assert rows(table) in PAGE.read_text(encoding="utf-8"), f"it needs\n{rows(table)}"


def test_parity_page_states_number_of_compared_names() -> None:
    count = sum(1 + len(entry.get("members", ())) for names in REAL.values() for entry in names.values())
    page = PAGE.read_text(encoding="utf-8")
    assert f"{len(REAL)} modules, {count} names" in page
    assert f"{len(json.loads(LYRICAL_RECORD.read_text(encoding='utf-8')))} names of rclpy 10" in page
