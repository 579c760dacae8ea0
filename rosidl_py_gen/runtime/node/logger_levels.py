"""Services ``~/get_logger_levels`` and ``~/set_logger_levels`` of a node.

Logger levels apply to the whole process. Source: docs/internals/protocol.md 9.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.msgs.rcl_interfaces.msg import LoggerLevel, SetLoggerLevelsResult
from rosidl_py_gen.msgs.rcl_interfaces.srv import (
    GetLoggerLevels,
    GetLoggerLevels_Request,
    GetLoggerLevels_Response,
    SetLoggerLevels,
    SetLoggerLevels_Request,
    SetLoggerLevels_Response,
)
from rosidl_py_gen.runtime.entities.message_types import service_type
from rosidl_py_gen.runtime.entities.server import ServiceServer
from rosidl_py_gen.runtime.logs.loggers import LogLevelError, get_logger_level, set_logger_level
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.cdr import Service
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames


def start_logger_services(scope: EntityScope, names: NodeNames) -> None:
    """Serve ``~/get_logger_levels`` and ``~/set_logger_levels`` of a node until it closes."""
    services: tuple[tuple[type[Service[Any, Any]], str, Callable[[Any], Any]], ...] = (
        (GetLoggerLevels, "~/get_logger_levels", _get),
        (SetLoggerLevels, "~/set_logger_levels", _set),
    )
    for cls, name, handler in services:
        ServiceServer(scope, service_type(cls), names.resolve_service(name), handler, SERVICES_DEFAULT)


def _get(request: GetLoggerLevels_Request) -> GetLoggerLevels_Response:
    return GetLoggerLevels_Response(
        levels=[LoggerLevel(name=name, level=get_logger_level(name)) for name in request.names]
    )


def _set(request: SetLoggerLevels_Request) -> SetLoggerLevels_Response:
    return SetLoggerLevels_Response(results=[_set_one(level) for level in request.levels])


def _set_one(level: LoggerLevel) -> SetLoggerLevelsResult:
    try:
        set_logger_level(level.name, level.level)
    except LogLevelError as error:
        return SetLoggerLevelsResult(successful=False, reason=str(error))
    return SetLoggerLevelsResult(successful=True)
