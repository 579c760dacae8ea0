"""Information about a publisher or subscription of a topic; rclpy 10 moved the classes to `rclpy.endpoint_info`."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, TypeVar

from rclpy.endpoint_info import EndpointTypeEnum as TopicEndpointTypeEnum
from rclpy.endpoint_info import TopicEndpointInfo
from rclpy.qos import QoSHistoryPolicy, QoSPresetProfiles, QoSProfile
from rclpy.type_hash import TypeHash
