"""Messages as bytes: functions, raw subscriptions, bytes that are published, and callbacks that ask for more."""

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("bytes")
text = String(data="héllo")
data = serialize_message(text)
print(type(data).__name__, data.hex(), deserialize_message(data, String) == text)
pose = PoseStamped()
pose.header.frame_id = "map"
pose.pose.position.x = 1.5
print(len(serialize_message(pose)), deserialize_message(serialize_message(pose), PoseStamped))
for wrong in (lambda: deserialize_message(b"\x00", String), lambda: serialize_message("x"), lambda: deserialize_message("x", String)):
    try:
        print(wrong())
    except Exception as error:
        print("refused")
got = []
raw = node.create_subscription(String, "raw", lambda msg: got.append((type(msg).__name__, deserialize_message(msg, String))), 10, raw=True)
two = node.create_subscription(String, "raw", lambda msg, info: got.append((msg.data, sorted(info))), 10)
publisher = node.create_publisher(String, "raw", 10)
while publisher.get_subscription_count() < 2:
    rclpy.spin_once(node, timeout_sec=0.05)
publisher.publish(data)
publisher.publish(String(data="object"))
while len(got) < 4:
    rclpy.spin_once(node, timeout_sec=1)
print(sorted(map(str, got)))
two.callback = lambda msg: got.append("new callback")
publisher.publish(text)
while "new callback" not in got:
    rclpy.spin_once(node, timeout_sec=1)
print(publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=5)), two.get_publisher_count(), raw.raw)
for wrong in ("text", 3, None, PoseStamped(), String):
    try:
        publisher.publish(wrong)
        print(type(wrong).__name__, "published")
    except Exception as error:
        print(type(wrong).__name__, isinstance(error, TypeError))
node.destroy_node()
rclpy.shutdown()
