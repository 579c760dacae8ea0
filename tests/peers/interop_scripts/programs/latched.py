"""A transient local publisher that publishes once."""

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from std_msgs.msg import String


def main():
    rclpy.init()
    node = Node("map_server", namespace="maps", enable_rosout=False, start_parameter_services=False)
    qos = QoSProfile(
        depth=1,
        history=QoSHistoryPolicy.KEEP_LAST,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
        reliability=QoSReliabilityPolicy.RELIABLE,
        deadline=Duration(seconds=5),
        lifespan=Duration(seconds=100.5),
    )
    publisher = node.create_publisher(String, "/map", qos)
    publisher.publish(String(data="walls"))
    print(publisher.topic_name, qos.deadline, qos.durability.name)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        print("bye")
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
