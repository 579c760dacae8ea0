"""Each policy of `rosidl_py_gen.runtime.QoSProfile` is a field of rclpy's QoS profile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from support.local_network import domain_id
from support.program_processes import output_lines

from rosidl_py_gen.runtime.qos import POLICIES

if TYPE_CHECKING:
    from pathlib import Path


def test_policies_keep_their_values_when_profiles_of_rclpy_are_converted(tmp_path: Path) -> None:
    program = """
        from rclpy.duration import Duration
        from rclpy.qos import QoSProfile
        from rosidl_py_gen.runtime.qos import DEFAULT, POLICIES

        for policy in POLICIES:
            value = 2 if policy.enum else not getattr(DEFAULT, policy.field) if "avoid" in policy.field else 7
            value = {"liveliness": 3, "reliability": 2, "durability": 1}.get(policy.field, value)
            given = Duration(nanoseconds=value) if policy.is_period else value
            profile = QoSProfile(**{"depth": 10, policy.rmw_name: given})
            converted = profile.get_c_qos_profile()
            assert value != getattr(DEFAULT, policy.field)
            print(policy.field, getattr(converted, policy.field) == value, QoSProfile(**converted.to_dict()) == profile)
    """
    assert output_lines(tmp_path, program) == [f"{policy.field} True True" for policy in POLICIES]


def test_parameters_override_policies_that_publishers_and_subscriptions_have(tmp_path: Path) -> None:
    program = """
        import rclpy
        from rclpy.qos import QoSPolicyKind
        from rclpy.qos_overriding_options import QoSOverridingOptions
        from std_msgs.msg import String

        options = QoSOverridingOptions([kind for kind in QoSPolicyKind if kind.name != "INVALID"])
        with rclpy.init(), rclpy.create_node("n") as node:
            node.create_publisher(String, "t", 10, qos_overriding_options=options)
            node.create_subscription(String, "t", print, 10, qos_overriding_options=options)
            for name in sorted(node.get_parameters_by_prefix("qos_overrides./t")):
                print(name)
    """
    publishers = [f"publisher.{policy.rmw_name}" for policy in POLICIES]
    subscriptions = [f"subscription.{policy.rmw_name}" for policy in POLICIES if not policy.is_for_publishers]
    settings = {"ROS_DOMAIN_ID": str(domain_id()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    assert output_lines(tmp_path, program, **settings) == sorted(publishers) + sorted(subscriptions)
