"""Parameter that enables a node's type description service; rosidl_py_gen itself serves it."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING

from rcl_interfaces.msg import ParameterDescriptor, ParameterType

from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_services_default
from rclpy.service import Service
from rclpy.type_support import check_is_valid_srv_type
from rclpy.validate_topic_name import TOPIC_SEPARATOR_STRING

if TYPE_CHECKING:
    from rclpy.node import BaseNode

START_TYPE_DESCRIPTION_SERVICE_PARAM = "start_type_description_service"


class TypeDescriptionService:
    """Read-only parameter of a node that enables its service ``get_type_description``."""

    def __init__(self, node: BaseNode) -> None:
        self.service_name = f"{node.get_name()}/get_type_description"
        name = START_TYPE_DESCRIPTION_SERVICE_PARAM
        if not node.has_parameter(name):
            text = "If enabled, start the ~/get_type_description service."
            node.declare_parameter(name, True, ParameterDescriptor(description=text, read_only=True))
        self.enabled = node.get_parameter(name).value is True
