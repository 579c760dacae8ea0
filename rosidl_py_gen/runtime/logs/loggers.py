"""ROS loggers, based on Python's `logging`, and the routing of their records to the nodes that publish them.

ROS loggers form a tree of their own, because their names are node names: a node "asyncio" must not change Python's
logger of that name, and the default level is INFO. Records also reach the handlers of Python's root logger.
Source: docs/internals/protocol.md 9.7.
"""

from __future__ import annotations

import io
import logging
import sys
import threading
import time
import traceback
from typing import TYPE_CHECKING, TypeAlias, TypedDict

from rosidl_py_gen.base.callbacks import Registration, RegistrationSet
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.names.validation import validate_node_name

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType

    from typing_extensions import Unpack

ExcInfo: TypeAlias = (
    "bool | BaseException | tuple[type[BaseException], BaseException, TracebackType | None]"
    " | tuple[None, None, None] | None"
)
Publish: TypeAlias = "Callable[[logging.LogRecord], None]"

UNSET, DEBUG, INFO, WARN, ERROR, FATAL = 0, 10, 20, 30, 40, 50
LEVEL_NAMES = {UNSET: "UNSET", DEBUG: "DEBUG", INFO: "INFO", WARN: "WARN", ERROR: "ERROR", FATAL: "FATAL"}
_LEVELS = {name: level for level, name in LEVEL_NAMES.items()}
_INTERNAL_FILES = frozenset({logging.info.__code__.co_filename, __file__})


class LogLevelError(RosidlError, ValueError):
    """Raised for a log level that does not exist."""


def parse_level(text: str) -> int:
    """Return the number of a ROS log level, given by its name in upper or lower case, such as ``debug``.

    Raises:
        LogLevelError: there is no such level.
    """
    level = _LEVELS.get(text.upper())
    if level is None:
        raise LogLevelError(f"unknown log level {text!r}; expected one of {', '.join(_LEVELS).lower()}")
    return level


def ros_level(level: int) -> int:
    """Return the ROS level for a Python level: the highest of 10, 20, 30, 40 and 50 that is not higher; at least 10."""
    return min(max(level // 10 * 10, DEBUG), FATAL)


def logger_name(fully_qualified_node_name: str) -> str:
    """Return the logger name for the fully qualified name of a node: ``/a/b/n`` becomes ``a.b.n``."""
    return fully_qualified_node_name.strip("/").replace("/", ".")


class LogOptions(TypedDict, total=False):
    """Keyword arguments of the logging methods of `RosLogger`; the last four are arguments of Python's `logging`."""

    once: bool
    throttle_s: float | None
    skip_first: bool
    exc_info: ExcInfo
    stack_info: bool
    stacklevel: int
    extra: Mapping[str, object] | None


class RosLogger(logging.Logger):
    """Logger with the options of ROS, from `get_logger` or `node.logger`.

    With `once`, a line of the program logs only its first call; with `skip_first`, all but the first call; with
    `throttle_s`, at most one call in that time, measured by the steady clock. Positional arguments are %-formatted into
    the message. A function that wraps a logger passes ``stacklevel=2``, so that its caller's line counts.
    """

    def __init__(self, name: str, level: int = UNSET) -> None:
        super().__init__(name, level)
        self._lock = threading.Lock()
        """Lock for the table of the lines of the program that have called the logger, with the times when they last
        logged."""
        self._reached: set[tuple[str, int]] = set()
        self._logged_s: dict[tuple[str, int], float] = {}

    def debug(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log a message at level DEBUG."""
        self._log_if(DEBUG, msg, args, **options)

    def info(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log a message at level INFO."""
        self._log_if(INFO, msg, args, **options)

    def warning(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log a message at level WARN."""
        self._log_if(WARN, msg, args, **options)

    warn = warning
    """Alias of `warning`, with the name that rclpy uses."""

    def error(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log a message at level ERROR."""
        self._log_if(ERROR, msg, args, **options)

    def fatal(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log a message at level FATAL."""
        self._log_if(FATAL, msg, args, **options)

    critical = fatal
    """Alias of `fatal`, with the name that Python's `logging` uses."""

    def exception(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log a message at level ERROR with the traceback of the exception that is being handled."""
        options.setdefault("exc_info", True)
        self._log_if(ERROR, msg, args, **options)

    def log(self, level: int, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log a message at any level, given by its number."""
        self._log_if(level, msg, args, **options)

    set_level = logging.Logger.setLevel
    """Alias of `setLevel`, with the name that rclpy uses."""

    get_effective_level = logging.Logger.getEffectiveLevel
    """Alias of `getEffectiveLevel`, with the name that rclpy uses."""

    is_enabled_for = logging.Logger.isEnabledFor
    """Alias of `isEnabledFor`, with the name that rclpy uses."""

    def get_child(self, suffix: str) -> RosLogger:
        """Return the logger ``<name>.<suffix>``, whose records the same node publishes."""
        return get_logger(suffix if self is _root else f"{self.name}.{suffix}")

    def _log_if(
        self,
        level: int,
        msg: object,
        args: tuple[object, ...],
        *,
        once: bool = False,
        throttle_s: float | None = None,
        skip_first: bool = False,
        exc_info: ExcInfo = None,
        stack_info: bool = False,
        stacklevel: int = 1,
        extra: Mapping[str, object] | None = None,
    ) -> None:
        if not self.isEnabledFor(level):
            return
        if once or skip_first or throttle_s is not None:
            site, now_s = self.findCaller(stacklevel=stacklevel)[:2], time.monotonic()
            with self._lock:
                is_first, last_s = site not in self._reached, self._logged_s.get(site)
                self._reached.add(site)
                is_too_early = last_s is not None and (once or now_s - last_s < (throttle_s or 0))
                if (skip_first and is_first) or is_too_early:
                    return
                self._logged_s[site] = now_s
        self._log(level, msg, args, exc_info=exc_info, extra=extra, stack_info=stack_info, stacklevel=stacklevel)

    def findCaller(self, stack_info: bool = False, stacklevel: int = 1) -> tuple[str, int, str, str | None]:
        # Find the frame outside this file and `logging`. Not by `super`, because CPython's rule changed in 3.11.
        frame = sys._getframe(1)
        while frame.f_back is not None and frame.f_code.co_filename in _INTERNAL_FILES:
            frame = frame.f_back
        for _ in range(stacklevel - 1):
            if frame.f_back is not None:
                frame = frame.f_back
        stack = None
        if stack_info:
            text = io.StringIO()
            traceback.print_stack(frame, file=text)
            stack = "Stack (most recent call last):\n" + text.getvalue().rstrip("\n")
        return frame.f_code.co_filename, frame.f_lineno, frame.f_code.co_name, stack


class _RosRoot(RosLogger):
    """Root of the ROS loggers, which passes its records to the handlers of Python's root logger."""

    def __init__(self) -> None:
        super().__init__("root", INFO)
        self.parent = logging.getLogger()


_root = _RosRoot()
_manager = logging.Manager(_root)  # type: ignore[arg-type]
_manager.setLoggerClass(RosLogger)
_root.manager = _manager


def get_root_logger() -> RosLogger:
    """Return the root of all ROS loggers; handlers added to it get all records."""
    return _root


def get_logger(name: str) -> RosLogger:
    """Return the ROS logger of a name, such as ``robot.driver`` for the node ``/robot/driver``; "" is the root.

    Records of a node's logger and its children are published on ``/rosout``.

    Raises:
        TypeError: `name` is not a string.
    """
    if not isinstance(name, str):
        raise TypeError(f"the name of a logger must be a str, got {name!r:.100}")
    if not name:
        return _root
    logger = _manager.getLogger(name)
    assert isinstance(logger, RosLogger)
    return logger


def internal_logger() -> RosLogger:
    """Return the logger of the runtime, for records that belong to no node."""
    return get_logger("rosidl_py_gen")


failure_listeners: RegistrationSet[Callable[[str, BaseException], None]] = RegistrationSet()
"""Functions called with a description and the exception of each failed callback; used by the pytest plugin."""


def report_failure(activity: str, logger: RosLogger | None = None, effect: str = "nothing else is affected") -> None:
    """Log the exception that is being handled, with its traceback, and notify `failure_listeners`.

    Args:
        activity: what has failed, such as ``"the callback of /chatter"``.
        logger: logger of a node; None uses `internal_logger`.
        effect: end of the message, about the effect of the failure.
    """
    (logger or internal_logger()).exception(f"{activity} failed; {effect}")
    error = sys.exc_info()[1]
    if error is not None:
        for listener in failure_listeners:
            listener(activity, error)


def node_logger(fully_qualified_node_name: str) -> RosLogger:
    """Return the logger of a node, given by its fully qualified name.

    Raises:
        InvalidNameError: the last part of the name is not a valid node name.
    """
    validate_node_name(fully_qualified_node_name.rpartition("/")[2])
    return get_logger(logger_name(fully_qualified_node_name))


def set_logger_level(name: str, level: int | str) -> None:
    """Set the level of a logger, which also applies to its children that have no level of their own.

    Args:
        name: name of the logger; empty for the root.
        level: ``"debug"``, ``"info"``, ``"warn"``, ``"error"``, ``"fatal"`` or ``"unset"``, in upper or lower case, or
            the number of the level, 10 to 50 and 0. ``"unset"`` makes the logger inherit its level again; the root
            becomes INFO.

    Raises:
        LogLevelError: the level does not exist.
        TypeError: the name is not a string.
    """
    number = parse_level(level) if isinstance(level, str) else level
    if not isinstance(number, int) or number not in LEVEL_NAMES:
        raise LogLevelError(f"unknown log level {level!r:.100}; expected one of {sorted(LEVEL_NAMES)}")
    logger = get_logger(name)
    logger.setLevel(INFO if logger is _root and number == UNSET else number)


def get_logger_level(name: str) -> int:
    """Return the number of the level that was set for a logger; 0 if the logger inherits its level.

    Raises:
        TypeError: `name` is not a string.
    """
    return get_logger(name).level


def message_text(record: logging.LogRecord) -> str:
    """Return the formatted message of a log record, followed by its traceback and stack, if there are any."""
    text = record.getMessage()
    if record.exc_info and record.exc_info[0] is not None:
        text += "\n" + "".join(traceback.format_exception(*record.exc_info)).rstrip("\n")
    if record.stack_info:
        text += "\n" + record.stack_info
    return text


class RosoutRouter(logging.Handler):
    """Handler of the ROS root logger that passes each record to the node of its logger, or of the nearest ancestor.

    The node publishes the record on ``/rosout``.
    """

    def __init__(self) -> None:
        super().__init__()
        self._publishers: dict[str, list[Publish]] = {}
        self._change_lock = threading.RLock()
        """Lock for changes of `_publishers`, which `emit` reads without a lock."""
        self._busy = threading.local()

    def register(self, logger_name: str, publish: Publish) -> Registration:
        """Publish records of a logger and its descendants with `publish` until the returned registration is closed.

        Of several nodes of one name only the oldest publishes.
        """
        with self._change_lock:
            self._publishers[logger_name] = [*self._publishers.get(logger_name, ()), publish]

        def remove() -> None:
            with self._change_lock:
                remaining = [one for one in self._publishers[logger_name] if one is not publish]
                if remaining:
                    self._publishers[logger_name] = remaining
                else:
                    del self._publishers[logger_name]

        return Registration(remove)

    def _publisher_of(self, logger_name: str) -> Publish | None:
        while logger_name:
            if publishers := self._publishers.get(logger_name):
                return publishers[0]
            logger_name = logger_name.rpartition(".")[0]
        return None

    def emit(self, record: logging.LogRecord) -> None:
        """Publish a log record on ``/rosout``, unless it was logged while another record is being published."""
        publish = self._publisher_of(record.name)
        if publish is None or getattr(self._busy, "now", False):
            return
        self._busy.now = True
        try:
            publish(record)
        except Exception:
            self.handleError(record)
        finally:
            self._busy.now = False


_router = RosoutRouter()


def shared_router() -> RosoutRouter:
    """Return the `RosoutRouter` of this process, after adding it to the ROS root logger."""
    get_root_logger().addHandler(_router)
    return _router
