"""From a log record to the fields of rcl_interfaces/Log, and to the node that publishes it.

Decides what the message says, and that each record is published once, by the node it belongs to. Records that belong to
no node are not published. `node/node.py` publishes them. Source: docs/internals/protocol.md 9.7.
"""

from __future__ import annotations

import logging
import threading
import traceback
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.base.registration import Registration
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.logs.loggers import get_root_logger, ros_level

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    Publish: TypeAlias = "Callable[[LogFields], None]"


@dataclass(frozen=True, slots=True)
class LogFields:
    """The fields of rcl_interfaces/Log; `stamp_ns` is system time even when simulated time is in use."""

    stamp_ns: int
    level: int
    name: str
    msg: str
    file: str
    function: str
    line: int


def message_text(record: logging.LogRecord) -> str:
    """The formatted message, followed by the traceback when the record has one."""
    text = record.getMessage()
    if record.exc_info and record.exc_info[0] is not None:
        text += "\n" + "".join(traceback.format_exception(*record.exc_info)).rstrip("\n")
    if record.stack_info:
        text += "\n" + record.stack_info
    return text


def log_fields(record: logging.LogRecord) -> LogFields:
    """What /rosout says about `record`."""
    return LogFields(
        round(record.created * NS_PER_S),
        ros_level(record.levelno),
        record.name,
        message_text(record),
        record.pathname,
        record.funcName or "",
        record.lineno,
    )


class RosoutRouter(logging.Handler):
    """A handler for the root of the ROS loggers that hands each record to the node it belongs to.

    That is the node registered for the record's logger or for its nearest ancestor. So a child logger counts as its
    parent's node, and a node `a.b` is never taken for a node `a`.
    """

    def __init__(self) -> None:
        super().__init__()
        self._publishers: dict[str, list[Publish]] = {}
        self._busy = threading.local()

    def register(self, logger_name: str, publish: Publish) -> Registration:
        """Publish the records of this logger and its descendants until the answer is closed.

        When two nodes have one name the older one publishes, so that nothing appears twice.
        """
        self._publishers.setdefault(logger_name, []).append(publish)

        def remove() -> None:
            found = self._publishers[logger_name]
            found.remove(publish)
            if not found:
                del self._publishers[logger_name]

        return Registration(remove)

    def _publisher_of(self, logger_name: str) -> Publish | None:
        while logger_name:
            found = self._publishers.get(logger_name)
            if found:
                return found[0]
            logger_name = logger_name.rpartition(".")[0]
        return None

    def emit(self, record: logging.LogRecord) -> None:
        """Publish one record; what publishing itself logs is not published again."""
        publish = self._publisher_of(record.name)
        if publish is None or getattr(self._busy, "now", False):
            return
        self._busy.now = True
        try:
            publish(log_fields(record))
        except Exception:
            self.handleError(record)
        finally:
            self._busy.now = False


_router = RosoutRouter()


def shared_router() -> RosoutRouter:
    """The one router of this process, installed on the root of the ROS loggers."""
    get_root_logger().addHandler(_router)
    return _router
