"""Services that read and set the levels of the loggers of a process."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import LoggerLevel, SetLoggerLevelsResult
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels

import rclpy.logging
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.qos import qos_profile_services_default
from rclpy.validate_topic_name import TOPIC_SEPARATOR_STRING

if TYPE_CHECKING:
    from rclpy.node import BaseNode


class LoggingService:
    """Services ``get_logger_levels`` and ``set_logger_levels`` of a node."""

    def __init__(self, node: BaseNode) -> None:
        for srv_type, name, callback in (
            (GetLoggerLevels, "get_logger_levels", self._get_logger_levels),
            (SetLoggerLevels, "set_logger_levels", self._set_logger_levels),
        ):
            full = TOPIC_SEPARATOR_STRING.join((node.get_name(), name))
            node.create_service(srv_type, full, callback, qos_profile=qos_profile_services_default)

    def _get_logger_levels(self, request: Any, response: Any) -> Any:
        for name in request.names:
            response.levels.append(LoggerLevel(name=name, level=int(rclpy.logging.get_logger_level(name))))
        return response

    def _set_logger_levels(self, request: Any, response: Any) -> Any:
        for level in request.levels:
            result = SetLoggerLevelsResult(successful=True)
            try:
                rclpy.logging.set_logger_level(level.name, level.level, detailed_error=True)
            except ValueError:
                result = SetLoggerLevelsResult(successful=False, reason="Failed reason: Invalid logger level.")
            response.results.append(result)
        return response
