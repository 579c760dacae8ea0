"""Simulated time: the topic /clock for the clocks of a node whose parameter ``use_sim_time`` is true."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any, List, Optional, Set

import rosgraph_msgs.msg
from rcl_interfaces.msg import SetParametersResult

from rclpy.clock import BaseClock, ROSClock
from rclpy.clock_type import ClockType
from rclpy.node_parameters import NodeParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time

if TYPE_CHECKING:
    from rclpy.node import BaseNode
    from rclpy.subscription import BaseSubscription

CLOCK_TOPIC = "/clock"
USE_SIM_TIME_NAME = "use_sim_time"


class TimeSource:
    """Subscription to /clock that sets the time of clocks, while the parameter ``use_sim_time`` of a node is true."""

    def __init__(self, *, node: BaseNode | None = None) -> None:
        self._clock_sub: BaseSubscription | None = None
        self._node_weak_ref: weakref.ref[BaseNode] | None = None
        self._associated_clocks: set[BaseClock] = set()
        self._last_time_set = Time(clock_type=ClockType.ROS_TIME)
        self._ros_time_is_active = False
        if node is not None:
            self.attach_node(node)

    @property
    def ros_time_is_active(self) -> bool:
        return self._ros_time_is_active

    @ros_time_is_active.setter
    def ros_time_is_active(self, enabled: bool) -> None:
        if self._ros_time_is_active == enabled:
            return
        self._ros_time_is_active = enabled
        for clock in self._associated_clocks:
            clock._set_ros_time_is_active(enabled)
        if enabled:
            self._subscribe_to_clock_topic()
        else:
            node = self._get_node()
            if self._clock_sub is not None and node is not None:
                node.rosidl_destroy_subscription(self._clock_sub)
                self._clock_sub = None

    def _subscribe_to_clock_topic(self) -> None:
        node = self._get_node()
        if self._clock_sub is None and node is not None:
            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._clock_sub = node.create_subscription(rosgraph_msgs.msg.Clock, CLOCK_TOPIC, self.clock_callback, qos)

    def attach_node(self, node: BaseNode) -> None:
        """Follow the parameter ``use_sim_time`` of a node, and declare it if necessary.

        Raises:
            TypeError: `node` is not a Node.
        """
        if not isinstance(node, NodeParameters):  # which only nodes are
            raise TypeError("Node must be of type rclpy.node.Node")
        if self._node_weak_ref is not None:
            self.detach_node()
        self._node_weak_ref = weakref.ref(node)
        if not node.has_parameter(USE_SIM_TIME_NAME):
            node.declare_parameter(USE_SIM_TIME_NAME, False)
        parameter = node.get_parameter(USE_SIM_TIME_NAME)
        if parameter.type_ == Parameter.Type.BOOL:
            self.ros_time_is_active = parameter.value
        elif parameter.type_ == Parameter.Type.NOT_SET:
            node.get_logger().debug(f"'{USE_SIM_TIME_NAME}' parameter not set, using wall time by default")
        else:
            text = f"Invalid type for parameter '{USE_SIM_TIME_NAME}' {parameter.type_!r} should be bool"
            node.get_logger().error(text)
        node.add_on_set_parameters_callback(self._on_parameter_event)

    def detach_node(self) -> None:
        """Stop following the parameter of a node; clocks keep their time.

        Raises:
            RuntimeError: the node of the subscription to /clock was deleted.
        """
        if self._clock_sub is not None:
            node = self._get_node()
            if node is None:
                raise RuntimeError("Unable to destroy previously created clock subscription")
            node.rosidl_destroy_subscription(self._clock_sub)
        self._clock_sub = None
        self._node_weak_ref = None

    def attach_clock(self, clock: BaseClock) -> None:
        """Set the time of a further clock from now on; raise ValueError unless its clock type is ROS_TIME."""
        if not isinstance(clock, BaseClock) or clock.clock_type != ClockType.ROS_TIME:
            raise ValueError("Only clocks with type ROS_TIME can be attached.")
        clock.set_ros_time_override(self._last_time_set)
        clock._set_ros_time_is_active(self.ros_time_is_active)
        self._associated_clocks.add(clock)

    def clock_callback(self, msg: Any) -> None:
        """Set the time of all attached clocks to the time in a rosgraph_msgs/Clock."""
        self._last_time_set = Time.from_msg(msg.clock)
        for clock in self._associated_clocks:
            clock.set_ros_time_override(self._last_time_set)

    def _on_parameter_event(self, parameter_list: list[Parameter]) -> Any:
        for parameter in parameter_list:
            if parameter.name != USE_SIM_TIME_NAME:
                continue
            if parameter.type_ != Parameter.Type.BOOL:
                reason = f"{USE_SIM_TIME_NAME} parameter set to something besides a bool"
                node = self._get_node()
                if node is not None:
                    node.get_logger().error(reason)
                return SetParametersResult(successful=False, reason=reason)
            self.ros_time_is_active = parameter.value
            break
        return SetParametersResult(successful=True)

    def _get_node(self) -> BaseNode | None:
        return None if self._node_weak_ref is None else self._node_weak_ref()
