"""Events: incompatible QoS, missed deadlines and matches, with callbacks and by default."""

import rclpy
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Int32

rclpy.init()
node = Node("events")
told = []


def until(condition):
    for _ in range(300):
        if condition():
            return
        rclpy.spin_once(node, timeout_sec=0.05)
    print("never", told)


best_effort = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
publisher = node.create_publisher(
    Int32,
    "mismatch",
    best_effort,
    event_callbacks=PublisherEventCallbacks(
        incompatible_qos=lambda e: told.append(("offered", e.total_count, e.total_count_change, int(e.last_policy_kind)))
    ),
)
subscription = node.create_subscription(
    Int32,
    "mismatch",
    print,
    QoSProfile(depth=5),
    event_callbacks=SubscriptionEventCallbacks(
        incompatible_qos=lambda e: told.append(("requested", e.total_count, e.total_count_change, int(e.last_policy_kind)))
    ),
)
until(lambda: len(told) == 2)
print(sorted(told))
told.clear()
node.destroy_subscription(subscription)
node.destroy_publisher(publisher)
defaults = node.create_publisher(Int32, "by_default", best_effort)
silent = node.create_subscription(
    Int32, "by_default", print, QoSProfile(depth=5),
    event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False, matched=lambda e: told.append("matched")),
)
for _ in range(10):
    rclpy.spin_once(node, timeout_sec=0.05)
print(told)
deadline = QoSProfile(depth=5, deadline=Duration(seconds=0.1))
publisher = node.create_publisher(
    Int32, "late", deadline,
    event_callbacks=PublisherEventCallbacks(
        deadline=lambda e: told.append(("offered late", e.total_count > 0)),
        matched=lambda e: told.append(("publisher", e.current_count, e.current_count_change)),
    ),
)
subscription = node.create_subscription(
    Int32, "late", lambda msg: told.append(msg.data), deadline,
    event_callbacks=SubscriptionEventCallbacks(
        deadline=lambda e: told.append(("requested late", e.total_count > 0)),
        matched=lambda e: told.append(("subscription", e.current_count, e.current_count_change)),
    ),
)
until(lambda: ("publisher", 1, 1) in told and ("subscription", 1, 1) in told)
publisher.publish(Int32(data=1))
until(lambda: ("offered late", True) in told and ("requested late", True) in told)
node.destroy_subscription(subscription)
until(lambda: ("publisher", 0, -1) in told)
print(sorted({str(one) for one in told}))
for wrong in (lambda: SubscriptionEventCallbacks(nothing=1), lambda: publisher.event_handlers):
    try:
        print(len(wrong()))
    except Exception as error:
        print(type(error).__name__)
node.destroy_node()
rclpy.shutdown()
