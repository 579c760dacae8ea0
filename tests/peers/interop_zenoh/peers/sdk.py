"""Peer on zenoh-ros2-sdk, whose topics and services are correct. Arguments and lines as in raw.py."""

import sys
import threading
import time

from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2ServiceServer, ROS2Subscriber

ROUTER, DOMAIN, SERVICE_HASH = sys.argv[1:4]
HOST, PORT = ROUTER.removeprefix("tcp/").split(":")
WHERE = {"domain_id": int(DOMAIN), "router_ip": HOST, "router_port": int(PORT)}
# With definitions and hashes it downloads nothing.
STRING = {
    "msg_type": "std_msgs/msg/String",
    "msg_definition": "string data",
    "type_hash": "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
}
SET_BOOL = {
    "srv_type": "std_srvs/srv/SetBool",
    "request_definition": "bool data",
    "response_definition": "bool success\nstring message",
    "type_hash": SERVICE_HASH,
}
lock = threading.Lock()


def say(*words: object) -> None:
    with lock:
        print(*words, flush=True)


subscription = ROS2Subscriber(
    "/to/peer", callback=lambda message: say("heard", message.data, 0, "-"), **STRING, **WHERE
)
publisher = ROS2Publisher("/from/peer", node_name="sdk", **STRING, **WHERE)
client = ROS2ServiceClient("/ours/set", **SET_BOOL, **WHERE)


def serve(request):
    say("asked", int(request.data))
    return server.response_msg_class(success=request.data, message="sdk")


server = ROS2ServiceServer("/peer/set", callback=serve, **SET_BOOL, **WHERE)


def publish_forever() -> None:
    number = 0
    while True:
        number += 1
        publisher.publish(data=f"sdk {number}")
        time.sleep(0.05)


threading.Thread(target=publish_forever, daemon=True).start()
say("ready", publisher.publisher_gid.hex())
for line in sys.stdin:
    match line.split():
        case ["call", value]:
            response = client.call(data=value == "1")
            say("answered", *((int(response.success), response.message) if response else ("nothing",)))
client.session_mgr.close()
