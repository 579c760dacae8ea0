"""Loggers of rclpy, over those of rosidl_py_gen, which decide levels and where records go."""

from __future__ import annotations

import inspect  # noqa: F401
import os
import sys
from collections import OrderedDict, namedtuple  # noqa: F401
from types import FrameType
from typing import Any, ClassVar, NamedTuple

from rclpy._rclpy_pybind11 import rclpy_logging_set_logger_level
from rclpy.clock import Clock
from rclpy.impl.logging_severity import LoggingSeverity
from rosidl_py_gen import runtime

runtime.print_logs()  # rclpy's loggers print before `rclpy.init`, too

_internal_callers = [__file__, os.path.join(os.path.dirname(os.path.dirname(__file__)), "logging.py")]
"""Parts of file names whose calls are not the call sites: what wraps loggers may add its own."""


def set_level(name: str, level: int) -> None:
    """Of a logger; the root, without a level, logs everything. ValueError for an unknown level."""
    rclpy_logging_set_logger_level(name, LoggingSeverity(level))


def as_severity(level: int) -> LoggingSeverity:
    """The one that a level counts as; programs may have set others by Python's `logging`."""
    return max(severity for severity in LoggingSeverity if severity <= level)


def _find_caller(frame: FrameType) -> tuple[FrameType, int]:
    """The first frame from here up that is no internal caller's, and how many are below it."""
    depth = 0
    while frame.f_back is not None and any(part in frame.f_code.co_filename for part in _internal_callers):
        frame = frame.f_back
        depth += 1
    return frame, depth


class _Site(NamedTuple):
    function_name: str
    file_path: str
    line_number: int
    last_index: int


class CallerId(_Site):
    """Where a logger was called; two calls in one line differ by `last_index`."""

    def __new__(cls, frame: FrameType | None = None) -> CallerId:
        frame = _find_caller(sys._getframe())[0] if frame is None else frame
        code = frame.f_code
        return super().__new__(cls, code.co_name, os.path.abspath(code.co_filename), frame.f_lineno, frame.f_lasti)


class LoggingFilter:
    """Decides, for each place that logs, whether a record passes. `params` has its options, None for required ones."""

    params: ClassVar[dict[str, Any]] = {}

    @classmethod
    def initialize_context(cls, context: dict[str, Any], **kwargs: Any) -> None:
        """Note the options of the first call. TypeError when a required one is missing."""
        for param, default in cls.params.items():
            context[param] = kwargs.get(param, default)
            if context[param] is None:
                text = f'Required parameter "{param}" was not specified for logging filter "{cls.__name__}"'
                raise TypeError(text)

    @staticmethod
    def should_log(context: dict[str, Any]) -> bool:
        """Whether this record passes; notes that it came."""
        return True


class Once(LoggingFilter):
    """Only the first record passes."""

    params: ClassVar[dict[str, Any]] = {"once": None}

    @classmethod
    def initialize_context(cls, context: dict[str, Any], **kwargs: Any) -> None:
        super().initialize_context(context, **kwargs)
        context["has_been_logged_once"] = False

    @staticmethod
    def should_log(context: dict[str, Any]) -> bool:
        passes = not context["has_been_logged_once"]
        context["has_been_logged_once"] = True
        return passes


class Throttle(LoggingFilter):
    """A record passes when the last one that passed is at least `throttle_duration_sec` ago, by a clock."""

    params: ClassVar[dict[str, Any]] = {"throttle_duration_sec": None, "throttle_time_source_type": Clock()}

    @classmethod
    def initialize_context(cls, context: dict[str, Any], **kwargs: Any) -> None:
        super().initialize_context(context, **kwargs)
        context["throttle_last_logged"] = 0
        clock = context["throttle_time_source_type"]
        if not isinstance(clock, Clock):
            raise ValueError(f'Received throttle_time_source_type of "{clock}" is not a clock instance')

    @staticmethod
    def should_log(context: dict[str, Any]) -> bool:
        now = context["throttle_time_source_type"].now().nanoseconds
        passes: bool = now >= context["throttle_last_logged"] + context["throttle_duration_sec"] * 1e9
        if passes:
            context["throttle_last_logged"] = now
        return passes


class SkipFirst(LoggingFilter):
    """All records pass but the first."""

    params: ClassVar[dict[str, Any]] = {"skip_first": None}

    @classmethod
    def initialize_context(cls, context: dict[str, Any], **kwargs: Any) -> None:
        super().initialize_context(context, **kwargs)
        context["first_has_been_skipped"] = False

    @staticmethod
    def should_log(context: dict[str, Any]) -> bool:
        passes: bool = context["first_has_been_skipped"]
        context["first_has_been_skipped"] = True
        return passes


supported_filters: OrderedDict[str, type[LoggingFilter]] = OrderedDict(
    throttle=Throttle, skip_first=SkipFirst, once=Once
)
"""In the order in which they are asked."""


def get_filters_from_kwargs(**kwargs: Any) -> list[str]:
    """The filters that the options of a call ask for. TypeError for unknown options, and for missing ones."""
    known = [param for filter_ in supported_filters.values() for param in filter_.params]
    wanted = [name for name, filter_ in supported_filters.items() if any(kwargs.get(param) for param in filter_.params)]
    for name in wanted:
        for param, default in supported_filters[name].params.items():
            if param not in kwargs and default is None:
                raise TypeError(
                    f'required parameter "{param}" not specified but is required for the the logging filter "{name}"'
                )
    for param in kwargs:
        if param not in known:
            raise TypeError(f'parameter "{param}" is not one of the recognized logging options "{known}"')
    return wanted


class RcutilsLogger:
    """A logger; get one from `Node.get_logger` or `rclpy.logging.get_logger`.

    The methods that log take a text, and the options `once`, `skip_first`, `throttle_duration_sec`,
    `throttle_time_source_type` (a Clock) and `name`. They return whether the record was logged. The options of one
    place may not change from call to call: ValueError.
    """

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.contexts: dict[CallerId, dict[str, Any]] = {}

    def get_child(self, name: str) -> RcutilsLogger:
        """The logger ``<name of this one>.<name>``; ValueError for an empty name."""
        if not name:
            raise ValueError("Child logger name must not be empty.")
        return RcutilsLogger(f"{self.name}.{name}" if self.name else name)

    def set_level(self, level: int) -> None:
        """Log from this severity on; UNSET for that of the logger above. ValueError for other numbers."""
        set_level(self.name, level)

    def get_effective_level(self) -> LoggingSeverity:
        """From which severity on records are logged."""
        return as_severity(runtime.get_logger(self.name).getEffectiveLevel())

    def is_enabled_for(self, severity: int) -> bool:
        """Whether a record of this severity would be logged; ValueError for a number that is none."""
        return runtime.get_logger(self.name).isEnabledFor(LoggingSeverity(severity))

    def log(self, message: str, severity: int, **kwargs: Any) -> bool:
        """Log at any severity; options as in the class. TypeError for a message that is no text."""
        if not self.is_enabled_for(severity):
            return False
        severity = LoggingSeverity(severity)
        name = kwargs.pop("name", self.name)
        filters = get_filters_from_kwargs(**kwargs)
        frame, depth = _find_caller(sys._getframe())
        if not self._passes(CallerId(frame), name, severity, filters, kwargs):
            return False
        if message is None:
            message = "(null)"  # which is what C makes of it
        if not isinstance(message, str):
            raise TypeError(f"a log message must be a str, got {type(message).__name__} {message!r:.100}")
        if severity:
            runtime.get_logger(name).log(severity, message, stacklevel=depth + 1)
        return True

    def _passes(
        self, site: CallerId, name: str, severity: LoggingSeverity, filters: list[str], options: dict[str, Any]
    ) -> bool:
        context = self.contexts.get(site)
        if context is None:
            context = {"name": name, "severity": severity, "filters": filters}
            for one in filters:
                supported_filters[one].initialize_context(context, **options)
            self.contexts[site] = context
        elif severity != context["severity"]:
            raise ValueError("Logger severity cannot be changed between calls.")
        elif name != context["name"]:
            raise ValueError("Logger name cannot be changed between calls.")
        elif filters != context["filters"]:
            raise ValueError("Requested logging filters cannot be changed between calls.")
        else:
            for one in filters:
                params = supported_filters[one].params
                if any(context[param] != options.get(param, default) for param, default in params.items()):
                    raise ValueError("Logging filter parameters cannot be changed between calls.")
        return all(supported_filters[one].should_log(context) for one in filters)

    def debug(self, message: str, **kwargs: Any) -> bool:
        """Log at DEBUG."""
        return self.log(message, LoggingSeverity.DEBUG, **kwargs)

    def info(self, message: str, **kwargs: Any) -> bool:
        """Log at INFO."""
        return self.log(message, LoggingSeverity.INFO, **kwargs)

    def warning(self, message: str, **kwargs: Any) -> bool:
        """Log at WARN."""
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def warn(self, message: str, **kwargs: Any) -> bool:
        """`warning`, which is the name to use."""
        return self.warning(message, **kwargs)

    def error(self, message: str, **kwargs: Any) -> bool:
        """Log at ERROR."""
        return self.log(message, LoggingSeverity.ERROR, **kwargs)

    def fatal(self, message: str, **kwargs: Any) -> bool:
        """Log at FATAL."""
        return self.log(message, LoggingSeverity.FATAL, **kwargs)
