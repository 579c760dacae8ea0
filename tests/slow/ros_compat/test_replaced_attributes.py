"""Values of other types in private attributes of rclpy's nodes: an error that names the attribute, when it is used."""

from __future__ import annotations

from pathlib import Path

from support.local_network import domain_id
from support.program_processes import output_lines

PROGRAM = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

rclpy.init()
uses = {
    "_clock": [Node.get_clock, lambda n: n.create_timer(1.0, print), lambda n: n.declare_parameter("p", 1)],
    "_logger": [Node.get_logger],
    "_default_callback_group": [lambda n: n.default_callback_group, lambda n: n.create_publisher(String, "t", 1)],
    "_rate_group": [lambda n: n.create_rate(1.0)],
    "_parameter_overrides": [lambda n: n.declare_parameter("p", 1)],
}
for name, calls in uses.items():
    node = Node(f"node{name}")
    setattr(node, name, None)
    for call in calls:
        try:
            call(node)
        except TypeError as error:
            print(error)
    print(node.has_parameter("p"))
    node.destroy_node()
node = Node("others")
node._context = None
node._timers, node._clients, node._publishers = {}, ["own"], None
fired = []
timer = node.create_timer(0.01, lambda: fired.append(1))
node.create_client(Trigger, "s"), node.create_publisher(String, "t", 1)
while not fired:
    rclpy.spin_once(node, timeout_sec=1)
print(node.context, node._timers, len(node._clients), node._publishers, list(node.timers) == [timer])
"""
REQUIRED_MEMBERS = [
    *[("_clock", "now"), ("_clock", "now"), ("_clock", "now"), None],
    *[("_logger", "info"), None],
    *[("_default_callback_group", "can_execute"), ("_default_callback_group", "can_execute"), None],
    *[("_rate_group", "can_execute"), None],
    *[("_parameter_overrides", "keys"), None],
]
"""Attribute and missing member of each error; None after the last use of an attribute."""


def test_attribute_of_another_type_raises_error_that_names_it(tmp_path: Path) -> None:
    cure = "give the program's own attribute another name"
    errors = [
        "False" if one is None else f"{one[0]} is an attribute of rclpy, and None has no {one[1]!r}: {cure}"
        for one in REQUIRED_MEMBERS
    ]
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    assert output_lines(tmp_path, PROGRAM, **settings) == [*errors, "None {} 2 None True"]
