"""A service and a client that are watched: who asked whom, with contents or without, and no more."""

import time

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_system_default
from rclpy.service_introspection import ServiceIntrospectionState
from std_srvs.srv import SetBool

rclpy.init()
node = Node("watched")
service = node.create_service(SetBool, "flip", lambda request, response: SetBool.Response(success=not request.data))
client = node.create_client(SetBool, "flip")
events, seen = set(), []


def heard(event):
    seen.append(event)
    events.add((event.info.event_type, len(event.request), len(event.response)))


node.create_subscription(SetBool.Event, "flip/_service_event", heard, 100)
client.wait_for_service()


def call():
    future = client.call_async(SetBool.Request(data=True))
    rclpy.spin_until_future_complete(node, future, timeout_sec=10)
    rclpy.spin_once(node, timeout_sec=0.02)
    return future.result()


def drain():
    quiet_since, looks = time.monotonic(), 0
    while looks < 15 or time.monotonic() < quiet_since + 0.3:
        seen.clear()
        rclpy.spin_once(node, timeout_sec=0.02)
        looks += 1
        if seen:
            quiet_since, looks = time.monotonic(), 0


print(ServiceIntrospectionState.METADATA, SetBool.Event.__name__)
for state, wanted in ((ServiceIntrospectionState.METADATA, 4), (ServiceIntrospectionState.CONTENTS, 4)):
    service.configure_introspection(node.get_clock(), qos_profile_system_default, state)
    client.configure_introspection(node.get_clock(), qos_profile_system_default, state)
    drain()
    events.clear()
    while len(events) < wanted:
        result = call()
    print(result, sorted(events))
for one in (service, client):
    one.configure_introspection(node.get_clock(), qos_profile_system_default, ServiceIntrospectionState.OFF)
drain()
events.clear()
call()
drain()
print(events)
node.destroy_node()
rclpy.shutdown()
