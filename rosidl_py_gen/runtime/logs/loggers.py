"""ROS loggers on top of Python's `logging`.

Decides names, levels and the `once` / `throttle_s` / `skip_first` options. ROS loggers live in a tree of their own,
because their names are node names: a node called "asyncio" must not change Python's logger of that name, and the
default level is INFO, not WARNING. Records still reach the handlers of Python's root logger, so `basicConfig`, pytest
and friends see them. Printing is `console.py`, publishing is `rosout.py`.

Source: docs/internals/protocol.md 9.7.
"""

from __future__ import annotations

import io
import logging
import sys
import threading
import time
import traceback
from typing import TYPE_CHECKING, TypedDict

from rosidl_py_gen.base.registration import RegistrationSet
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.names.validation import validate_node_name

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType
    from typing import TypeAlias

    from typing_extensions import Unpack

    ExcInfo: TypeAlias = (
        "bool | BaseException | tuple[type[BaseException], BaseException, TracebackType | None]"
        " | tuple[None, None, None] | None"
    )

UNSET, DEBUG, INFO, WARN, ERROR, FATAL = 0, 10, 20, 30, 40, 50
LEVEL_NAMES = {UNSET: "UNSET", DEBUG: "DEBUG", INFO: "INFO", WARN: "WARN", ERROR: "ERROR", FATAL: "FATAL"}
_LEVELS = {name: level for level, name in LEVEL_NAMES.items()}
_INTERNAL_FILES = frozenset({logging.info.__code__.co_filename, __file__})


class LogLevelError(RosidlError, ValueError):
    """The caller asked for a log level that does not exist."""


def parse_level(text: str) -> int:
    """The number of ``debug``, ``info``, ``warn``, ``error``, ``fatal`` or ``unset``, in any case."""
    level = _LEVELS.get(text.upper())
    if level is None:
        raise LogLevelError(f"unknown log level {text!r}; expected one of {', '.join(_LEVELS).lower()}")
    return level


def ros_level(level: int) -> int:
    """The ROS level a Python level counts as: the highest of 10, 20, 30, 40, 50 that is not above it."""
    return min(max(level // 10 * 10, DEBUG), FATAL)


def logger_name(fully_qualified_node_name: str) -> str:
    """The logger name of a node: ``/a/b/n`` becomes ``a.b.n``."""
    return fully_qualified_node_name.strip("/").replace("/", ".")


class LogOptions(TypedDict, total=False):
    """Keyword arguments of every logging call; the last four are those of Python's `logging`.

    `stacklevel` 2 makes it the call of whoever called, in the record and for `once`, `throttle_s` and `skip_first`.
    """

    once: bool
    throttle_s: float | None
    skip_first: bool
    exc_info: ExcInfo
    stack_info: bool
    stacklevel: int
    extra: Mapping[str, object] | None


class CallSiteFilter:
    """Remembers, per call site, whether an `once`, `throttle_s` or `skip_first` call may pass."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seen: set[tuple[str, int]] = set()
        self._passed_s: dict[tuple[str, int], float] = {}

    def passes(
        self, site: tuple[str, int], now_s: float, *, once: bool, throttle_s: float | None, skip_first: bool
    ) -> bool:
        """True when the record of `site` shall be logged; all given conditions must agree."""
        with self._lock:
            first = site not in self._seen
            self._seen.add(site)
            if skip_first and first:
                return False
            previous_s = self._passed_s.get(site)
            if once and previous_s is not None:
                return False
            if throttle_s is not None and previous_s is not None and now_s - previous_s < throttle_s:
                return False
            self._passed_s[site] = now_s
            return True


class RosLogger(logging.Logger):
    """A logger with the ROS options; get one from `get_logger` or `node.logger`.

    `once` logs the first time this line is reached, `throttle_s` at most every so many seconds (steady time),
    `skip_first` not the first time. Extra positional arguments are %-formatted into the message as in `logging`.
    A function that wraps a logger gives ``stacklevel=2``: then the line is that of its caller.
    """

    def __init__(self, name: str, level: int = UNSET) -> None:
        super().__init__(name, level)
        self._sites = CallSiteFilter()

    def debug(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log at DEBUG."""
        self._maybe(DEBUG, msg, args, **options)

    def info(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log at INFO."""
        self._maybe(INFO, msg, args, **options)

    def warning(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log at WARN."""
        self._maybe(WARN, msg, args, **options)

    warn = warning
    """`warning`, as rclpy spells it."""

    def error(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log at ERROR."""
        self._maybe(ERROR, msg, args, **options)

    def fatal(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log at FATAL."""
        self._maybe(FATAL, msg, args, **options)

    critical = fatal
    """`fatal`, as Python spells it."""

    def exception(self, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log at ERROR with the traceback of the exception being handled."""
        options.setdefault("exc_info", True)
        self._maybe(ERROR, msg, args, **options)

    def log(self, level: int, msg: object, *args: object, **options: Unpack[LogOptions]) -> None:
        """Log at any level."""
        self._maybe(level, msg, args, **options)

    set_level = logging.Logger.setLevel
    """`setLevel`, as rclpy spells it."""

    get_effective_level = logging.Logger.getEffectiveLevel
    """`getEffectiveLevel`, as rclpy spells it."""

    is_enabled_for = logging.Logger.isEnabledFor
    """`isEnabledFor`, as rclpy spells it."""

    def get_child(self, suffix: str) -> RosLogger:
        """The logger ``<name>.<suffix>``; it publishes to /rosout through the same node."""
        return get_logger(suffix if self is _root else f"{self.name}.{suffix}")

    def _maybe(
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
        **unknown: object,
    ) -> None:
        if unknown:
            raise TypeError(f"log() got an unexpected keyword argument {next(iter(unknown))!r}")
        if not self.isEnabledFor(level):
            return
        if once or skip_first or throttle_s is not None:
            file, line, _, _ = self.findCaller(stacklevel=stacklevel)
            now_s = time.monotonic()
            if not self._sites.passes((file, line), now_s, once=once, throttle_s=throttle_s, skip_first=skip_first):
                return
        self._log(level, msg, args, exc_info=exc_info, extra=extra, stack_info=stack_info, stacklevel=stacklevel)

    def findCaller(self, stack_info: bool = False, stacklevel: int = 1) -> tuple[str, int, str, str | None]:
        # The frame outside this file and `logging`; written out because CPython's rule changed in 3.11.
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
    """The root of the ROS tree; its records go on to the handlers of Python's root logger."""

    def __init__(self) -> None:
        super().__init__("root", INFO)
        self.parent = logging.getLogger()


_root = _RosRoot()
_manager = logging.Manager(_root)  # type: ignore[arg-type]
_manager.setLoggerClass(RosLogger)
_root.manager = _manager


def get_root_logger() -> RosLogger:
    """The logger every ROS logger inherits from; handlers belong here."""
    return _root


def get_logger(name: str) -> RosLogger:
    """The ROS logger of that name, such as ``robot.driver`` for the node ``/robot/driver``; always the same object.

    It needs no node. An empty name is the root, whose level counts where no other is set. What loggers say goes to
    ``/rosout`` where they are that of a node, or below it.

    Raises:
        TypeError: the name is no text.
    """
    if not isinstance(name, str):
        raise TypeError(f"the name of a logger must be a text, got {name!r:.100}")
    if not name:
        return _root
    logger = _manager.getLogger(name)
    assert isinstance(logger, RosLogger)
    return logger


def internal_logger() -> RosLogger:
    """Where the runtime reports what belongs to no node; below the ROS root, so levels and outputs count for it."""
    return get_logger("rosidl_py_gen")


failure_listeners: RegistrationSet[Callable[[str, BaseException], None]] = RegistrationSet()
"""Called with what failed and its exception, for each failure of any node; the pytest plugin listens."""


def report_failure(doing: str, logger: RosLogger | None = None, effect: str = "nothing else is affected") -> None:
    """Log the exception being handled, with its traceback, as a node or as `internal_logger`."""
    (logger or internal_logger()).exception(f"{doing} failed; {effect}")
    error = sys.exc_info()[1]
    if error is not None:
        for hear in failure_listeners:
            hear(doing, error)


def node_logger(fully_qualified_node_name: str) -> RosLogger:
    """The logger of a node; raises `InvalidNameError` when the last part is no node name."""
    validate_node_name(fully_qualified_node_name.rpartition("/")[2])
    return get_logger(logger_name(fully_qualified_node_name))


def set_logger_level(name: str, level: int | str) -> None:
    """Set the level of a logger, and of those below it that have none of their own.

    Args:
        name: of the logger; empty for the root.
        level: ``"debug"``, ``"info"``, ``"warn"``, ``"error"``, ``"fatal"`` or ``"unset"``, in any case, or its number,
            10 to 50 and 0. ``"unset"`` lets the logger inherit again; the root becomes INFO.

    Raises:
        LogLevelError: there is no such level. TypeError: the name is no text.
    """
    number = parse_level(level) if isinstance(level, str) else level
    if not isinstance(number, int) or number not in LEVEL_NAMES:
        raise LogLevelError(f"unknown log level {level!r:.100}; expected one of {sorted(LEVEL_NAMES)}")
    logger = get_logger(name)
    logger.setLevel(INFO if logger is _root and number == UNSET else number)


def get_logger_level(name: str) -> int:
    """The level that was set, 0 when the logger inherits; `RosLogger.getEffectiveLevel` has what counts.

    Raises:
        TypeError: the name is no text.
    """
    return get_logger(name).level
