"""Routing of log records to the node that publishes them on ``/rosout``.

Source: docs/internals/protocol.md 9.7.
"""

from __future__ import annotations

import logging
import threading
import traceback
from typing import TYPE_CHECKING

from rosidl_py_gen.base.registration import Registration
from rosidl_py_gen.runtime.logs.loggers import get_root_logger

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    Publish: TypeAlias = "Callable[[logging.LogRecord], None]"


def message_text(record: logging.LogRecord) -> str:
    """Return the formatted message, followed by the traceback if there is one."""
    text = record.getMessage()
    if record.exc_info and record.exc_info[0] is not None:
        text += "\n" + "".join(traceback.format_exception(*record.exc_info)).rstrip("\n")
    if record.stack_info:
        text += "\n" + record.stack_info
    return text


class RosoutRouter(logging.Handler):
    """Handler of the ROS root logger that passes each record to the node of its logger, or of the nearest ancestor."""

    def __init__(self) -> None:
        super().__init__()
        self._publishers: dict[str, list[Publish]] = {}
        self._busy = threading.local()

    def register(self, logger_name: str, publish: Publish) -> Registration:
        """Publish the records of this logger and its descendants until the registration is closed.

        Of several nodes of one name only the oldest publishes.
        """
        self._publishers.setdefault(logger_name, []).append(publish)

        def remove() -> None:
            publishers = self._publishers[logger_name]
            publishers.remove(publish)
            if not publishers:
                del self._publishers[logger_name]

        return Registration(remove)

    def _publisher_of(self, logger_name: str) -> Publish | None:
        while logger_name:
            if publishers := self._publishers.get(logger_name):
                return publishers[0]
            logger_name = logger_name.rpartition(".")[0]
        return None

    def emit(self, record: logging.LogRecord) -> None:
        """Publish a record, except for records of the publishing itself."""
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
    """Return the router of this process, after adding it to the ROS root logger."""
    get_root_logger().addHandler(_router)
    return _router
