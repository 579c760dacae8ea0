"""Graph information of a node about itself and another node of the same program."""

import rclpy
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from std_msgs.msg import Int32, String
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("looks", namespace="/a")
other = rclpy.create_node("other", namespace="/b", enable_rosout=False, start_parameter_services=False)
publisher = other.create_publisher(String, "chatter", QoSProfile(depth=3))
other.create_publisher(String, "chatter", 1)
other.create_subscription(Int32, "/abs", print, qos_profile_sensor_data)
other.create_service(Trigger, "~/go", lambda request, response: response)
client = node.create_client(Trigger, "/b/other/go")


def until(condition):
    for _ in range(200):
        if condition():
            return
        rclpy.spin_once(node, timeout_sec=0.05)
    print("never")


until(lambda: node.count_publishers("/b/chatter") == 2 and node.count_subscribers("/abs") == 1 and client.service_is_ready())
until(lambda: ("other", "/b") in node.get_node_names_and_namespaces())
print(sorted(node.get_node_names()), sorted(node.get_node_names_and_namespaces()))
print(sorted(node.get_node_names_and_namespaces_with_enclaves()), sorted(node.get_fully_qualified_node_names()))
print(sorted(node.get_topic_names_and_types()))
print(sorted(node.get_service_names_and_types())[-2:])
print(node.get_publisher_names_and_types_by_node("other", "/b"))
print(node.get_subscriber_names_and_types_by_node("other", "/b"))
dds_topics = node.get_publisher_names_and_types_by_node("other", "/b", no_demangle=True)
print([topic for topic in dds_topics if topic[0].endswith(("chatter", "goReply"))])
print(node.get_service_names_and_types_by_node("other", "/b"))
print(node.get_client_names_and_types_by_node("looks", "/a"))
try:
    node.get_publisher_names_and_types_by_node("nobody", "/")
except NodeNameNonExistentError as error:
    print(type(error).__name__)
print(node.count_clients("/b/other/go"), node.count_services("/b/other/go"), node.count_publishers("nothing"))
infos = sorted(node.get_publishers_info_by_topic("/b/chatter"), key=lambda info: info.topic_type)
print([(i.node_name, i.node_namespace, i.topic_type, i.endpoint_type.name, len(i.endpoint_gid)) for i in infos])
print(infos[0].qos_profile.reliability, infos[0].qos_profile.durability.name, infos[0].qos_profile.deadline)
info = node.get_subscriptions_info_by_topic("/abs")[0]
print(info.qos_profile.reliability.short_key, info.qos_profile.liveliness.name, info.topic_type_hash)
print(node.resolve_topic_name("x"), node.resolve_topic_name("~/x"), node.resolve_service_name("/x"))
print(node.resolve_topic_name("{node}/{ns}") if False else node.resolve_topic_name("{node}/x"))
print(node.wait_for_node("/b/other", 5.0), node.wait_for_node("/nobody", 0.1))
print(publisher.topic, publisher.topic_name, client.srv_name, client.service_name)
print(len(list(other.publishers)), len(list(other.subscriptions)), len(list(node.clients)), len(list(node.timers)))
for wrong in (lambda: node.count_publishers("not valid"), lambda: node.get_publishers_info_by_topic("not valid"),
              lambda: node.get_topic_names_and_types(True)[:0]):
    try:
        print(wrong())
    except Exception as error:
        print(type(error).__name__)
rclpy.shutdown()
