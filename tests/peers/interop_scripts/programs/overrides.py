"""Quality of service that parameters override, and a callback that looks at it."""

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from std_msgs.msg import String


def check(qos):
    print("check", qos.depth, qos.reliability.name)
    return SetParametersResult(successful=qos.depth < 50, reason="too deep")


rclpy.init()
node = Node("overrides")
publisher = node.create_publisher(
    String, "chatter", 10, qos_overriding_options=QoSOverridingOptions.with_default_policies(callback=check)
)
subscription = node.create_subscription(
    String,
    "chatter",
    print,
    QoSProfile(depth=5),
    qos_overriding_options=QoSOverridingOptions(
        [QoSPolicyKind.DURABILITY, QoSPolicyKind.DEADLINE, QoSPolicyKind.LIVELINESS], entity_id="main"
    ),
)
try:
    node.create_publisher(
        String, "deep", 10, qos_overriding_options=QoSOverridingOptions([QoSPolicyKind.DEPTH], callback=check)
    )
except InvalidQosOverridesError as error:
    print(type(error).__name__, error)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
