"""Serialization, and checks for classes of messages and services."""
# ruff: noqa
# fmt: off

from std_msgs.msg import String
import std_srvs.srv
from test_msgs.action import Fibonacci as LookupTransform
from rclpy.serialization import serialize_message, deserialize_message
from rclpy.type_support import *
from rclpy.type_hash import TypeHash
from rclpy.utilities import remove_ros_args, timeout_sec_to_nsec
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

serialize_message(String(data="x"))
serialize_message(5)
serialize_message(String)
serialize_message(None)
deserialize_message(serialize_message(String(data="x")),String)
deserialize_message(b"",String)  # text
deserialize_message(b"\0\1\0\0\xff\0\0\0",String)  # text
deserialize_message("a",String)  # text
deserialize_message(bytearray(serialize_message(String(data="x"))),String)  # text
deserialize_message(b"\0\1\0\0",5)
serialize_message(String(data=5))  # text
check_for_type_support(String)
check_for_type_support(5)
check_for_type_support(int)
check_for_type_support(std_srvs.srv.Empty)
check_for_type_support(LookupTransform)
check_is_valid_msg_type(String)
check_is_valid_msg_type(std_srvs.srv.Empty)
check_is_valid_msg_type(LookupTransform)
check_is_valid_srv_type(String)
check_is_valid_srv_type(std_srvs.srv.Empty)
check_is_valid_srv_type(LookupTransform)
check_is_valid_srv_type(int)
check_is_valid_msg_type(String())
check_is_valid_msg_type(std_srvs.srv.Empty.Request)
str(TypeHash())
str(TypeHash(1, bytes(range(32))))
str(TypeHash(1, b"x"))
TypeHash(1) == TypeHash(1)
TypeHash(1) == 5
TypeHash("a")  # text
TypeHash(1, "a")  # text
hash(TypeHash())
remove_ros_args(["p", "--ros-args", "-r", "a:=b", "--", "x"])
remove_ros_args(["p", "a:=b", "__ns:=/x", "--", "--k=v"])
remove_ros_args(["--ros-args", "-p", "a:=1", "--", "--", "q"])
remove_ros_args([])
timeout_sec_to_nsec(None)
timeout_sec_to_nsec(-1)
timeout_sec_to_nsec(1.5)
topic_or_service_is_hidden("/a/_b")
topic_or_service_is_hidden("/a/b_")
