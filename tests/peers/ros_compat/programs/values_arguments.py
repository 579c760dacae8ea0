"""Arguments that rclpy takes besides the documented ones: the result of `init` as a context, a message as a type."""
# ruff: noqa
# fmt: off

import time
import rclpy
from rclpy.clock import Clock
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import String
from std_srvs.srv import SetBool

context = rclpy.init(args=[])
n = Node("a", context=context)
type(rclpy.create_node("b", context=context)).__name__
rclpy.ok(context=context)
n.context is rclpy.utilities.get_default_context()
executor = SingleThreadedExecutor(context=context)
executor.context is n.context
MultiThreadedExecutor(2, context=context).context is n.context
type(GuardCondition(print, None, context=context)).__name__
Clock().sleep_for(Duration(seconds=0.01), context=context)
executor.add_node(n)
got = []
n.create_timer(0.01, lambda: got.append(1))
executor.spin_until_future_complete(rclpy.Future(), timeout_sec=0.3)
bool(got)
rclpy.init(args=[], context=context)
Node("x", context=5)  # text


def received(*subscriptions, publisher):
    """Publish and return what the subscriptions of `n` get."""
    end = time.time() + 10
    while publisher.get_subscription_count() < len(subscriptions) and time.time() < end:
        time.sleep(0.02)
    messages.clear()
    publisher.publish(String(data="a"))
    while len(messages) < len(subscriptions) and time.time() < end:
        executor.spin_once(timeout_sec=0.1)
    return sorted(messages)


messages = []
publisher = n.create_publisher(String, "t", 10)
s = n.create_subscription(String(data="mine"), "t", lambda m: messages.append((type(m).__name__, m.data)), 10)
r = n.create_subscription(String(), "t", lambda m: messages.append(("raw", type(m).__name__)), 10, raw=True)
received(s, r, publisher=publisher)
s.msg_type
n.get_subscriptions_info_by_topic("/t")[0].topic_type
wait_for_message(String(), n, "nothing", time_to_wait=0.1)
q = n.create_publisher(String(data="mine"), "u", 10)
q.msg_type
n.get_publishers_info_by_topic("/u")[0].topic_type
q.publish(String())
q.publish(b"")
q.publish(5)
type(n.create_subscription(SetBool.Request(), "v", print, 10)).__name__
n.create_publisher(None, "w", 10)
n.create_publisher(5, "w", 10)
n.create_publisher("std_msgs/msg/String", "w", 10)
n.create_publisher(SetBool, "w", 10)
n.create_subscription([String], "w", print, 10)
n.create_service(String(), "w", print)
n.create_client(String, "w")
n.create_client(None, "w")
SetBool()

log = RcutilsLogger("a")
log.log("x", 20, name=None)
log.log("x", 20, name="b")
log.log("x", 20, name="")
log.log("x", 10, name=None)
log.info("x", name=None)
log.get_child("c").warning("x", name=None, once=True)
log.log("x", 20, name=5)  # text

rclpy.shutdown(context=context)
rclpy.ok(context=context)
_ = rclpy.init(args=[], context=context)
type(Node("again", context=context)).__name__
rclpy.try_shutdown(context=context)
rclpy.try_shutdown(context=context)
rclpy.shutdown(context=context)
