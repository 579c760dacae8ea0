"""Loggers of rclpy; the loggers of rosidl_py_gen decide about levels and outputs."""

from __future__ import annotations

import inspect
import os
import sys
from collections import OrderedDict, namedtuple
from types import FrameType
from typing import Any, ClassVar, NamedTuple

from rclpy._rclpy_pybind11 import rclpy_logging_get_logger_effective_level, rclpy_logging_set_logger_level
from rclpy.clock import Clock
from rclpy.impl.logging_severity import LoggingSeverity
from rosidl_py_gen import runtime

runtime.print_logs()  # rclpy's loggers print before `rclpy.init`, too

_internal_callers = [__file__, os.path.join(os.path.dirname(os.path.dirname(__file__)), "logging.py")]
"""Parts of paths that mark a frame as internal, so it is not reported as call site; wrappers of loggers may add their
own paths."""


def _find_caller(frame: FrameType) -> tuple[FrameType, int]:
    """Return the stack frame that called the logger: the first one upwards that is not internal, and the number of
    frames below it.
    """
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
    """Call site of a logger; two calls in one line of the program differ in `last_index`."""

    def __new__(cls, frame: FrameType | None = None) -> CallerId:
        frame = _find_caller(sys._getframe())[0] if frame is None else frame
        code = frame.f_code
        return super().__new__(cls, code.co_name, os.path.abspath(code.co_filename), frame.f_lineno, frame.f_lasti)


class LoggingFilter:
    """Base of filters that decide for each call site which records are logged.

    The dict `params` contains the filter's options with their defaults, None for required options.
    """

    params: ClassVar[dict[str, Any]] = {}

    @classmethod
    def initialize_context(cls, context: dict[str, Any], **kwargs: Any) -> None:
        """Store the options of the first logging call at a call site in the context of the call site."""
        for param, default in cls.params.items():
            context[param] = kwargs.get(param, default)

    @staticmethod
    def should_log(context: dict[str, Any]) -> bool:
        """Return True if the filter passes the current record."""
        return True


class Once(LoggingFilter):
    """Filter that passes only the first record of a call site."""

    params: ClassVar[dict[str, Any]] = {"once": None}

    @staticmethod
    def should_log(context: dict[str, Any]) -> bool:
        passes = "has_been_logged_once" not in context
        context["has_been_logged_once"] = True
        return passes


class Throttle(LoggingFilter):
    """Filter that passes at most one record of a call site in `throttle_duration_sec` seconds of a clock."""

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
    """Filter that passes all records of a call site except the first."""

    params: ClassVar[dict[str, Any]] = {"skip_first": None}

    @staticmethod
    def should_log(context: dict[str, Any]) -> bool:
        passes = "first_has_been_skipped" in context
        context["first_has_been_skipped"] = True
        return passes


supported_filters: OrderedDict[str, type[LoggingFilter]] = OrderedDict(
    throttle=Throttle, skip_first=SkipFirst, once=Once
)
"""Filters of logging calls by name, in the order of their evaluation."""


def get_filters_from_kwargs(**kwargs: Any) -> list[str]:
    """Return the names of the filters that the options of a logging call request.

    Raises:
        TypeError: an option is unknown, or a required option is missing.
    """
    known_params = [param for filter_ in supported_filters.values() for param in filter_.params]
    requested = [
        name for name, filter_ in supported_filters.items() if any(kwargs.get(param) for param in filter_.params)
    ]
    for name in requested:
        for param, default in supported_filters[name].params.items():
            if kwargs.get(param, default) is None:
                raise TypeError(
                    f'required parameter "{param}" not specified but is required for the the logging filter "{name}"'
                )
    for param in kwargs:
        if param not in known_params:
            raise TypeError(f'parameter "{param}" is not one of the recognized logging options "{known_params}"')
    return requested


class RcutilsLogger:
    """Logger, returned by `Node.get_logger` and `rclpy.logging.get_logger`.

    The methods that log take a text, and the options `once`, `skip_first`, `throttle_duration_sec`,
    `throttle_time_source_type` (a Clock) and `name`. They return True if the record was logged. Options that differ
    between calls at one call site raise ValueError.
    """

    def __init__(self, name: str = "") -> None:
        self.name = name
        self.contexts: dict[CallerId, dict[str, Any]] = {}

    def get_child(self, name: str) -> RcutilsLogger:
        """Return the logger ``<name of this logger>.<name>``; raise ValueError for an empty name."""
        if not name:
            raise ValueError("Child logger name must not be empty.")
        return RcutilsLogger(f"{self.name}.{name}" if self.name else name)

    def set_level(self, level: int) -> None:
        """Set the lowest severity that is logged, UNSET to inherit it; raise ValueError for other numbers."""
        rclpy_logging_set_logger_level(self.name, LoggingSeverity(level))

    def get_effective_level(self) -> LoggingSeverity:
        """Return the lowest severity that is logged."""
        return LoggingSeverity(rclpy_logging_get_logger_effective_level(self.name))

    def is_enabled_for(self, severity: int) -> bool:
        """Return True if a severity is logged; raise ValueError for an unknown number."""
        return runtime.get_logger(self.name).isEnabledFor(LoggingSeverity(severity))

    def log(self, message: str, severity: int, **kwargs: Any) -> bool:
        """Log a message at a severity, by default with the name of the logger; raise TypeError unless it is a str."""
        if not self.is_enabled_for(severity):
            return False
        severity = LoggingSeverity(severity)
        name = kwargs.pop("name", None)
        name = self.name if name is None else name
        filters = get_filters_from_kwargs(**kwargs)
        frame, depth = _find_caller(sys._getframe())
        if not self._passes_filters(CallerId(frame), name, severity, filters, kwargs):
            return False
        if message is None:
            message = "(null)"  # as in rclpy, which formats it in C
        if not isinstance(message, str):
            raise TypeError(f"log message must be a str, got {type(message).__name__} {message!r:.100}")
        if severity:
            runtime.get_logger(name).log(severity, message, stacklevel=depth + 1)
        return True

    def _passes_filters(
        self, site: CallerId, name: str, severity: LoggingSeverity, filters: list[str], options: dict[str, Any]
    ) -> bool:
        context = self.contexts.get(site)
        if context is None:
            context = {"name": name, "severity": severity, "filters": filters}
            for filter_ in filters:
                supported_filters[filter_].initialize_context(context, **options)
            self.contexts[site] = context
        elif severity != context["severity"]:
            raise ValueError("Logger severity cannot be changed between calls.")
        elif name != context["name"]:
            raise ValueError("Logger name cannot be changed between calls.")
        elif filters != context["filters"]:
            raise ValueError("Requested logging filters cannot be changed between calls.")
        else:
            for filter_ in filters:
                params = supported_filters[filter_].params
                if any(context[param] != options.get(param, default) for param, default in params.items()):
                    raise ValueError("Logging filter parameters cannot be changed between calls.")
        return all(supported_filters[filter_].should_log(context) for filter_ in filters)

    def debug(self, message: str, **kwargs: Any) -> bool:
        return self.log(message, LoggingSeverity.DEBUG, **kwargs)

    def info(self, message: str, **kwargs: Any) -> bool:
        return self.log(message, LoggingSeverity.INFO, **kwargs)

    def warning(self, message: str, **kwargs: Any) -> bool:
        return self.log(message, LoggingSeverity.WARN, **kwargs)

    def warn(self, message: str, **kwargs: Any) -> bool:
        """Log a message at severity WARN; `warning` is the preferred name."""
        return self.warning(message, **kwargs)

    def error(self, message: str, **kwargs: Any) -> bool:
        return self.log(message, LoggingSeverity.ERROR, **kwargs)

    def fatal(self, message: str, **kwargs: Any) -> bool:
        return self.log(message, LoggingSeverity.FATAL, **kwargs)
