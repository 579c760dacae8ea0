"""ROS loggers, based on Python's `logging`, and the outputs of their records: /rosout, the console and the log file.

ROS loggers form a tree of their own, because their names are node names: a node "asyncio" must not change Python's
logger of that name, and the default level is INFO. Records go to the nodes that publish them, and also reach the
handlers of Python's root logger.

The first open context selects the outputs; a warning reports different settings of another context. Unlike in ROS, a
log file is written only on request, by ``--log-file-name``, ``--enable-external-lib-logs`` or ``ROS_LOG_DIR``, and not
with ``--disable-external-lib-logs``. Files have the format of rcl_logging_spdlog; only the name prefix differs: the
name of the program instead of ``python3``. Each line is written at once. The console prints nothing while the root
logger of Python has handlers: these handlers get all records, which would appear twice.
Source: docs/internals/protocol.md 9.7, 10.4, 10.6.
"""

from __future__ import annotations

import io
import logging
import os
import re
import sys
import threading
import time
import traceback
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, TextIO, TypeAlias, TypedDict

from rosidl_py_gen.base.callbacks import Registration, RegistrationSet
from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.names import validate_node_name

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
_PACKAGE_FOLDER = str(Path(__file__).parents[1]) + os.sep


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


def caller_stacklevel() -> int:
    """Return the `stacklevel` of a record that names the first caller outside of this package; 1 if there is none."""
    frame, level = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_code.co_filename in _INTERNAL_FILES:
        frame = frame.f_back
    while frame.f_code.co_filename.startswith(_PACKAGE_FOLDER):
        if frame.f_back is None:
            return 1
        frame, level = frame.f_back, level + 1
    return level


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


# -------------------------------------------------------------------------------------------------------------- outputs

DEFAULT_FORMAT = "[{severity}] [{time}] [{name}]: {message}"
_TOKEN = re.compile(r"\{([a-z_]+)\}")
_COLORS = {DEBUG: "\x1b[32m", WARN: "\x1b[33m", ERROR: "\x1b[31m", FATAL: "\x1b[31m"}
_COLOR_END = "\x1b[0m"


@dataclass(frozen=True, slots=True)
class ConsoleSettings:
    """Settings for printing log records on the console.

    Attributes:
        format: text with ``{tokens}``, as in ``RCUTILS_CONSOLE_OUTPUT_FORMAT``.
        colorized: print colours; None: only on a terminal.
        use_stdout: print on stdout instead of stderr.
    """

    format: str = DEFAULT_FORMAT
    colorized: bool | None = None
    use_stdout: bool = False


def read_console_environment(environ: Mapping[str, str]) -> ConsoleSettings:
    """Return the console settings of the ``RCUTILS_...`` variables; a switch counts only if its value is 0 or 1."""
    colorized = {"0": False, "1": True}.get(environ.get("RCUTILS_COLORIZED_OUTPUT", ""))
    return ConsoleSettings(
        environ.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or DEFAULT_FORMAT,
        colorized,
        environ.get("RCUTILS_LOGGING_USE_STDOUT") == "1",
    )


def format_record(record: logging.LogRecord, format_text: str = DEFAULT_FORMAT) -> str:
    """Return a log record as text: replace the known ``{tokens}`` of a format; unknown tokens remain, as in rcutils."""
    values = {
        "severity": LEVEL_NAMES[ros_level(record.levelno)],
        "name": record.name,
        "message": message_text(record),
        "function_name": record.funcName or "",
        "file_name": record.pathname,
        "line_number": str(record.lineno),
    }
    now_ns = round(record.created * NS_PER_S)
    seconds, nanoseconds = sec_nanosec(now_ns)
    values["time"] = f"{seconds}.{nanoseconds:09d}"
    values["time_as_nanoseconds"] = str(now_ns)
    values["date_time_with_ms"] = datetime.fromtimestamp(record.created).isoformat(" ", "milliseconds")
    return _TOKEN.sub(lambda match: values.get(match.group(1), match.group()), format_text)


class ConsoleHandler(logging.Handler):
    """Handler that writes log records to the file object that is `sys.stderr` or `sys.stdout` at the time of the
    record.
    """

    def __init__(self, settings: ConsoleSettings | None = None) -> None:
        super().__init__()
        self.settings = settings or ConsoleSettings()

    def emit(self, record: logging.LogRecord) -> None:
        if logging.getLogger().handlers:
            return
        stream = sys.stdout if self.settings.use_stdout else sys.stderr
        try:
            stream.write(self._line(record, stream) + "\n")
            stream.flush()
        except Exception:
            self.handleError(record)

    def _line(self, record: logging.LogRecord, stream: TextIO) -> str:
        line = format_record(record, self.settings.format)
        colorized = stream.isatty() if self.settings.colorized is None else self.settings.colorized
        color = _COLORS.get(ros_level(record.levelno), "")
        return f"{color}{line}{_COLOR_END}" if colorized and color else line


console_handler = ConsoleHandler()
"""Handler that prints all ROS log records; attached to the ROS root logger while printing is switched on."""


def print_logs() -> None:
    """Start to print log records on the console, with the settings of the ``RCUTILS_...`` variables.

    Opening the first context does so, too; a program calls this function if it logs before that. A context with
    ``--disable-stdout-logs`` stops the printing.
    """
    install_console(read_console_environment(os.environ))


def install_console(settings: ConsoleSettings, *, prints: bool = True) -> None:
    """Start to print all ROS log records on the console, or stop that with ``prints=False``."""
    console_handler.settings = settings
    root = get_root_logger()
    if prints:
        root.addHandler(console_handler)
    else:
        root.removeHandler(console_handler)


class LogFileError(RosidlError, OSError):
    """Raised if a log file cannot be written."""


def get_logging_directory(environ: Mapping[str, str] | None = None) -> Path:
    """Return the folder for log files: ``$ROS_LOG_DIR``, else ``$ROS_HOME/log``, else ``~/.ros/log``.

    Args:
        environ: environment variables; None means the environment of this process.

    Raises:
        LogFileError: the home folder is unknown.
    """
    environ = os.environ if environ is None else environ
    folder = Path(environ.get("ROS_LOG_DIR") or Path(environ.get("ROS_HOME") or "~/.ros") / "log")
    try:
        return folder.expanduser()
    except RuntimeError as error:
        raise LogFileError(f"the folder for log files, {folder}, is unknown: {error}; set ROS_LOG_DIR") from error


def program_prefix(program: str) -> str:
    """Return the default prefix of a log file: the program's name without folder and ``.py``."""
    if program in ("", "-", "-c", "-m"):
        return "python"
    path = Path(program)
    if path.name == "__main__.py" and path.parent.name:
        path = path.parent
    return re.sub(r"[^\w.-]", "_", path.name.removesuffix(".py")) or "python"


class LogFile(logging.FileHandler):
    """Handler that appends log records to a file, in the format of the console without colours.

    Raises:
        LogFileError: the file cannot be created.
    """

    def __init__(self, path: Path, format_text: str = DEFAULT_FORMAT) -> None:
        self._format = format_text
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            super().__init__(path, encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            raise LogFileError(
                f"the log file {path} cannot be written: {error.strerror or error}; "
                "set ROS_LOG_DIR to another folder, or use --ros-args --disable-external-lib-logs"
            ) from error

    def format(self, record: logging.LogRecord) -> str:
        return format_record(record, self._format)


@dataclass(frozen=True, slots=True)
class LogSettings:
    """Logging options of a command line.

    Attributes:
        level: level of the root logger; None: INFO.
        levels: (logger name, level) in the order of the command line.
        file_name: prefix of the name of the log file; empty: the program's name.
        stdout, rosout: the switches ``--enable-…-logs`` and ``--disable-…-logs``; the last switch counts.
        external_lib: the switches ``--enable-external-lib-logs`` and ``--disable-external-lib-logs``, which enable the
            log file; None if absent.
    """

    level: int | None = None
    levels: tuple[tuple[str, int], ...] = ()
    file_name: str = ""
    stdout: bool = True
    rosout: bool = True
    external_lib: bool | None = None

    def wants_file(self, environ: Mapping[str, str]) -> bool:
        """Return True if the command line or the environment requests a log file."""
        if self.external_lib is False:
            return False
        return bool(self.external_lib or self.file_name or environ.get("ROS_LOG_DIR"))


class LogOutputs:
    """Log outputs of this process, which exist while at least one context is open."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._users = 0
        self._selected: tuple[bool, tuple[Path, str] | None] = (True, None)
        self._file: LogFile | None = None

    def open(self, settings: LogSettings, program: str, environ: Mapping[str, str]) -> None:
        """Open the log outputs for a context, and set the levels of its command line.

        Raises:
            LogFileError: the log file cannot be created.
        """
        location = None
        if settings.wants_file(environ):
            location = get_logging_directory(environ), settings.file_name or program_prefix(program)
        with self._lock:
            if self._users == 0:
                self._select(settings.stdout, location, environ)
            self._users += 1
        if settings.level is not None:
            set_logger_level("", settings.level)
        for name, level in settings.levels:
            set_logger_level(name, level)
        if (settings.stdout, location) not in ((True, None), self._selected):
            get_root_logger().warning(
                "log switches and log file of this context are ignored: a process has one console and one log file, "
                "which the first context has selected",
                stacklevel=caller_stacklevel(),
            )

    def _select(self, stdout: bool, location: tuple[Path, str] | None, environ: Mapping[str, str]) -> None:
        settings = read_console_environment(environ)
        if location is not None:
            folder, prefix = location
            name = f"{prefix}_{os.getpid()}_{time.time_ns() // 1_000_000}.log"
            self._file = LogFile(folder / name, settings.format)
            get_root_logger().addHandler(self._file)
        install_console(settings, prints=stdout)
        self._selected = stdout, location

    def close(self) -> None:
        """Undo one call of `open`; the last call closes the log file, but not the console."""
        with self._lock:
            self._users -= 1
            if self._users == 0 and self._file is not None:
                self._drop_file().close()

    def _drop_file(self) -> LogFile:
        assert self._file is not None
        file, self._file = self._file, None
        get_root_logger().removeHandler(file)
        return file

    def after_fork(self) -> None:
        """Reset the log outputs in a forked child, because the parent owns the log file and its threads may hold the
        lock.
        """
        self._lock, self._users = threading.RLock(), 0
        if self._file is not None:
            self._drop_file()


outputs = LogOutputs()
