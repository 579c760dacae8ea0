"""Our rclpy has the names of the real one, with their kinds, parameters and values; what is missing is listed here.

The record of the real one is made by `rclpy_record.py`, which describes ours in the same words. docs/rclpy.md says the
same as the tables of this file; where it does not, a failed test prints what has to stand there.
"""

from __future__ import annotations

import enum
import importlib
import inspect
import json
import sys
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rclpy_record import RECORD, describe, kind_of, parameters_of, plain

PAGE = Path(__file__).resolve().parents[2] / "docs" / "rclpy.md"
REAL: dict[str, dict[str, Any]] = json.loads(RECORD.read_text(encoding="utf-8"))
MISSING = {
    "functions of C, which no handle of ours has": (
        "rclpy.clock.ClockHandle.add_clock_callback",
        "rclpy.clock.ClockHandle.remove_clock_callback",
        "rclpy.impl.implementation_singleton.import_c_library",
    ),
    "count what C's logging needs, which is not there": (
        "rclpy.context.g_logging_configure_lock",
        "rclpy.context.g_logging_ref_count",
    ),
    "the service is served below rclpy and ends with its node": (
        "rclpy.type_description_service.GetTypeDescription",
        "rclpy.type_description_service.TypeDescriptionService.destroy",
    ),
    "what a module imports for its own lines, and is imported elsewhere by its own name": (
        "rclpy.clock.TYPE_CHECKING",
        "rclpy.event_handler.rclpy",
        "rclpy.experimental.events_executor.rclpy",
        "rclpy.qos_event.rclpy",
        "rclpy.qos_overriding_options.rclpy",
        "rclpy.utilities.ament_index_python",
    ),
    "a name for checkers of types inside of the class": ("rclpy.exceptions.InvalidParameterTypeException.Parameter",),
}
"""Reason -> names of rclpy that ours has not. Those of the standard library are not counted: see `of_python`."""
OTHER_VALUES = {
    "an enumeration of names; its numbers are used in C only": tuple(
        f"rclpy.action.server.GoalEvent.{name}" for name in ("ABORT", "CANCELED", "CANCEL_GOAL", "EXECUTE", "SUCCEED")
    ),
}
"""Reason -> constants whose values differ."""
MORE = {
    "parts of `rclpy.node` and `rclpy.action.server`, in files of their own": (
        "rclpy.action.server_goal",
        "rclpy.node_entities",
        "rclpy.node_graph",
        "rclpy.node_parameters",
    ),
    "what stands where rclpy has C, in files of their own": (
        "rclpy.handles",
        "rclpy.impl.action_endpoints",
        "rclpy.impl.lifecycle_machine",
        "rclpy.impl.names",
        "rclpy.impl.parameter_rules",
        "rclpy.mismatches",
        "rclpy.readiness",
    ),
    "what stands where rclpy has classes and functions of C": (
        "rclpy.clock.ClockHandle.is_valid",
        "rclpy.context.mark_all_shut_down",
        "rclpy.context.refused_arguments",
        "rclpy.duration.DurationType.nanoseconds",
        "rclpy.event_handler.EventHandle",
        "rclpy.guard_condition.GuardConditionHandle",
        "rclpy.impl.rcutils_logger.as_severity",
        "rclpy.impl.rcutils_logger.set_level",
        "rclpy.time.TimeHandle.clock_type",
        "rclpy.time.TimeHandle.nanoseconds",
        "rclpy.timer.TimerHandle",
        "rclpy.waitable.WaitSet",
    ),
    "all handles of C have it but that of a clock": ("rclpy.clock.ClockHandle.pointer",),
    "names of types for checkers": ("rclpy.lifecycle.node.Described",),
    "a value of the middleware that rclpy has no name for": ("rclpy.qos.RMW_QOS_DEADLINE_BEST_AVAILABLE",),
    "there under `rclpy.executors` in rclpy": ("rclpy.task.await_or_execute",),
    "fields that a namedtuple made by a call has as well, unrecorded": tuple(
        f"rclpy.impl.rcutils_logger.CallerId.{name}"
        for name in ("file_path", "function_name", "last_index", "line_number")
    ),
}
"""Reason -> names of ours that begin with a letter and rclpy has not: no program can count on them."""


def of_python(name: str, entry: dict[str, Any]) -> bool:
    """Whether a module imports the name from the standard library, such as ``rclpy.node.List``."""
    if defined := entry.get("from"):
        return str(defined).partition(".")[0] in sys.stdlib_module_names
    return entry["kind"] == "constant" and "value" not in entry and name in vars(typing)


def found(holder: Any, name: str) -> tuple[bool, Any]:
    """Whether a module or class has a name, and what it is; the latter is None where instances have it only."""
    if not inspect.isclass(holder):
        return hasattr(holder, name), getattr(holder, name, None)
    instances = {one for base in holder.__mro__ for one in vars(base).get("__annotations__", ())}
    if name in instances or (issubclass(holder, enum.Enum) and name in ("name", "value")):
        return True, None
    return hasattr(holder, name), inspect.getattr_static(holder, name, None)


def compare(path: str, entry: dict[str, Any], thing: Any) -> Iterator[tuple[str, str, Any]]:
    """What differs: ``(path, aspect, what ours has)``."""
    if entry["kind"] != "property" and kind_of(thing) != entry["kind"]:
        yield path, "kind", kind_of(thing)
    parameters = entry.get("parameters")
    if parameters is not None and parameters_of(thing) != parameters:
        yield path, "parameters", parameters_of(thing)
    if "value" in entry and plain(getattr(thing, "value", thing)) != entry["value"]:
        yield path, "value", thing
    for name, member in entry.get("members", {}).items():
        there, one = found(thing, name)
        if not there:
            yield f"{path}.{name}", "missing", None
        elif one is not None:
            yield from compare(f"{path}.{name}", member, one)


def differences() -> Iterator[tuple[str, str, Any]]:
    modules = {name: importlib.import_module(name) for name in REAL}  # all, before any is asked for its submodules
    for module_name, names in REAL.items():
        module = modules[module_name]
        for name, entry in names.items():
            if of_python(name, entry):
                continue
            there, thing = found(module, name)
            if not there:
                yield f"{module_name}.{name}", "missing", None
            else:
                yield from compare(f"{module_name}.{name}", entry, thing)


def members_of(module: str, name: str, seen: tuple[str, ...] = ()) -> set[str]:
    """Members of a recorded class and its recorded bases."""
    entry = REAL.get(module, {}).get(name)
    if entry is None or f"{module}.{name}" in seen:
        return set()
    seen = (*seen, f"{module}.{name}")
    if "members" not in entry:
        return members_of(entry["from"], name, seen) if "from" in entry else set()
    bases = (base.rpartition(".") for base in entry["bases"])
    return set(entry["members"]).union(*(members_of(base, last, seen) for base, _, last in bases))


def more() -> Iterator[str]:
    """Public names that our modules define and rclpy has not; what they import for themselves is not counted."""
    for module_name, names in describe("rclpy").items():
        if module_name not in REAL:
            yield module_name
            continue
        for name, entry in names.items():
            recorded = REAL[module_name].get(name)
            if recorded is None:
                imported = entry["kind"] == "module" or "from" in entry or name == "annotations" or name in vars(typing)
                if not imported:
                    yield f"{module_name}.{name}"
            elif "members" in recorded and "members" in entry:
                cls = getattr(importlib.import_module(module_name), name)
                own = {one for base in cls.__mro__ if base.__module__.startswith("rclpy") for one in vars(base)}
                known = members_of(module_name, name)
                yield from (f"{module_name}.{name}.{one}" for one in sorted(own - known) if not one.startswith("_"))


def listed(table: dict[str, tuple[str, ...]]) -> list[str]:
    return sorted(name for names in table.values() for name in names)


def rows(table: dict[str, tuple[str, ...]]) -> str:
    """As the page has it."""
    return "".join(f"| {', '.join(f'`{name}`' for name in names)} | {reason} |\n" for reason, names in table.items())


@pytest.mark.filterwarnings("ignore:importing 'qos_event'")
def test_what_differs_from_the_real_rclpy_is_listed() -> None:
    different = list(differences())
    assert sorted(path for path, what, _ in different if what == "missing") == listed(MISSING)
    assert sorted(path for path, what, _ in different if what == "value") == listed(OTHER_VALUES)
    assert [one for one in different if one[1] not in ("missing", "value")] == []


@pytest.mark.filterwarnings("ignore:importing 'qos_event'")
def test_names_of_ours_are_explained() -> None:
    assert sorted(more()) == listed(MORE)


@pytest.mark.parametrize("table", [MISSING, OTHER_VALUES, MORE], ids=["missing", "values", "more"])
def test_the_page_says_the_same(table: dict[str, tuple[str, ...]]) -> None:
    assert rows(table) in PAGE.read_text(encoding="utf-8"), f"it needs\n{rows(table)}"


def test_the_page_counts_what_was_compared() -> None:
    count = sum(1 + len(entry.get("members", ())) for names in REAL.values() for entry in names.values())
    assert f"{len(REAL)} modules, {count} names" in PAGE.read_text(encoding="utf-8")
