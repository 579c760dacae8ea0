"""Services ``~/get_logger_levels`` and ``~/set_logger_levels`` of a node.

Logger levels apply to the whole process. Source: docs/internals/protocol.md 9.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.msgs.rcl_interfaces import msg, srv
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
        (srv.GetLoggerLevels, "~/get_logger_levels", _get_logger_levels),
        (srv.SetLoggerLevels, "~/set_logger_levels", _set_logger_levels),
    )
    for cls, name, handler in services:
        ServiceServer(scope, service_type(cls), names.resolve_service(name), handler, SERVICES_DEFAULT)


def _get_logger_levels(request: srv.GetLoggerLevels_Request) -> srv.GetLoggerLevels_Response:
    return srv.GetLoggerLevels_Response(
        levels=[msg.LoggerLevel(name=name, level=get_logger_level(name)) for name in request.names]
    )


def _set_logger_levels(request: srv.SetLoggerLevels_Request) -> srv.SetLoggerLevels_Response:
    return srv.SetLoggerLevels_Response(results=[_set_logger_level(level) for level in request.levels])


def _set_logger_level(level: msg.LoggerLevel) -> msg.SetLoggerLevelsResult:
    try:
        set_logger_level(level.name, level.level)
    except LogLevelError as error:
        return msg.SetLoggerLevelsResult(successful=False, reason=str(error))
    return msg.SetLoggerLevelsResult(successful=True)
