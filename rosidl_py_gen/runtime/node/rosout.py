"""Publishes what a node logs on ``/rosout``.

Decides the message; which record belongs to which node is `logs/rosout.py`. Source: docs/internals/protocol.md 9.7.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.msgs.rcl_interfaces.msg import Log
from rosidl_py_gen.runtime.endpoints.publisher import Publisher
from rosidl_py_gen.runtime.endpoints.types import message_type
from rosidl_py_gen.runtime.logs.rosout import shared_router
from rosidl_py_gen.runtime.transport.qos import ROSOUT

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.logs.rosout import LogFields


def start_rosout(scope: Scope) -> None:
    """Publish what is logged as this node until it closes."""
    publisher: Publisher[Log] = Publisher(scope, message_type(Log), "/rosout", ROSOUT)

    def publish(fields: LogFields) -> None:
        sec, nanosec = sec_nanosec(fields.stamp_ns)
        publisher._publish_without_waiting(
            Log(
                stamp=Time(sec=sec, nanosec=nanosec),
                level=fields.level,
                name=fields.name,
                msg=fields.msg,
                file=fields.file,
                function=fields.function,
                line=fields.line,
            )
        )

    scope.own(shared_router().register(scope.logger.name, publish))
