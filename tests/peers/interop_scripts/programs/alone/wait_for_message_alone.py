"""wait_for_message: with and without a message, latched, and beside a node that spins elsewhere."""

import threading

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("waits")
print(wait_for_message(String, node, "nothing", time_to_wait=0.1))
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
publisher = node.create_publisher(String, "latched", latched)
publisher.publish(String(data="kept"))
print(wait_for_message(String, node, "latched", qos_profile=latched, time_to_wait=10))
print(wait_for_message(String, node, "latched", time_to_wait=0.1))
heard = []
node.create_subscription(String, "news", lambda msg: heard.append(msg.data), 10)
news = node.create_publisher(String, "news", 10)
stop = threading.Event()


def publish():
    while not stop.wait(0.02):
        news.publish(String(data="new"))


thread = threading.Thread(target=publish)
thread.start()
print(wait_for_message(String, node, "news", time_to_wait=10), heard)
stop.set()
thread.join()
rclpy.spin_once(node, timeout_sec=1)
print(heard[:1], len(list(node.subscriptions)))
node.destroy_node()
rclpy.shutdown()
