"""Services of parameters and loggers, their client, events, overridden quality of service, and simulated time."""
# ruff: noqa
# fmt: off

import pathlib
import tempfile
import time
import rclpy
from rcl_interfaces.msg import LoggerLevel, Log, ParameterDescriptor, ParameterEvent, ParameterValue, SetParametersResult
from rcl_interfaces.msg import Parameter as Message
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels, SetParameters
from rclpy.clock import ROSClock
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.parameter_event_handler import ParameterEventHandler
from rclpy.qos import QoSPolicyKind, QoSProfile, qos_profile_unknown
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.time_source import TimeSource
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

rclpy.init(args=["--ros-args", "-p", "qos_overrides./out.publisher.depth:=7", "-p", "qos_overrides./bad.publisher.history:=nonsense"])  # ours: a context manager, as in Kilted
n = Node("n", enable_logger_service=True)
asker = Node("asker")
executor = rclpy.executors.SingleThreadedExecutor()
(executor.add_node(n), executor.add_node(asker), executor.add_node(n))
c = AsyncParameterClient(asker, "n")
seen = []


def done(future):
    executor.spin_until_future_complete(future, 10)
    return future.result()


def spin(until):
    end = time.monotonic() + 10
    while not until() and time.monotonic() < end:
        executor.spin_once(0.1)
    return bool(until())


def ask(srv_type, name, **fields):
    client = asker.create_client(srv_type, name)
    assert client.wait_for_service(10)
    return done(client.call_async(srv_type.Request(**fields)))


c.wait_for_services(10)
c.services_are_ready()
AsyncParameterClient(asker, "nobody").wait_for_services(0.1)
h = ParameterEventHandler(asker)
one = h.add_parameter_callback("a", "n", lambda p: seen.append(("one", p.value.integer_value)))
two = h.add_parameter_callback("a", "/n", lambda p: seen.append(("two", p.value.integer_value)))
all_of_them = h.add_parameter_event_callback(lambda e: seen.append((e.node, [p.name for p in e.new_parameters], [p.name for p in e.changed_parameters], [p.name for p in e.deleted_parameters])))
spin(lambda: asker.count_publishers("/parameter_events") == 2 and asker.count_subscribers("/parameter_events") == 1)
_ = [executor.spin_once(0.1) for _ in range(20)]
seen.clear()
n.declare_parameter("a", 1)
n.declare_parameter("b", "x", ParameterDescriptor(read_only=True, description="d"))
n.declare_parameter("dyn", None, ParameterDescriptor(dynamic_typing=True))
n.declare_parameter("unset", Parameter.Type.INTEGER)
spin(lambda: len(seen) >= 6)
(list(seen), seen.clear())
done(c.list_parameters()).result
done(c.list_parameters(["a"], 1)).result
done(c.get_parameters(["a", "b"]))
done(c.get_parameters(["a", "nope"]))
done(c.get_parameters(["unset"]))
done(c.get_parameter_types(["a", "b", "unset"]))
done(c.get_parameter_types(["nope"]))
done(c.describe_parameters(["b"]))
done(c.describe_parameters(["b", "nope"]))
done(c.set_parameters([Parameter("a", value=2), Parameter("b", value="y"), Parameter("a", value="x").to_parameter_msg()]))
done(c.set_parameters([Parameter("dyn", value=1)]))
done(c.set_parameters_atomically([Parameter("a", value=3), Parameter("b", value="y")]))
done(c.get_parameters(["a"]))
done(c.delete_parameters(["dyn", "a"]))
done(c.set_parameters([Parameter("nope", value=1)]))  # ours: rclpy forgets to name it
spin(lambda: len(seen) >= 5)
(list(seen), seen.clear())
(h.remove_parameter_callback(one), h.remove_parameter_event_callback(all_of_them))
h.remove_parameter_callback(one)
h.remove_parameter_event_callback(all_of_them)
done(c.set_parameters([Parameter("a", value=4)], callback=lambda f: seen.append("called")))
spin(lambda: len(seen) >= 2)
sorted(map(str, seen))
event = ParameterEvent(node="/n", new_parameters=[Message(name="p")], changed_parameters=[Message(name="q")])
(h.get_parameter_from_event(event, "q", "/n").name, h.get_parameter_from_event(event, "q", "/m"), [p.name for p in h.get_parameters_from_event(event)])
h.destroy()
file = pathlib.Path(tempfile.mkdtemp()) / "given.yaml"
_ = file.write_text("/n:\n  ros__parameters:\n    a: 9\n/**:\n  ros__parameters:\n    a: 8\n    b: z\n")
done(c.load_parameter_file(str(file)))
done(c.load_parameter_file_atomically(str(file), use_wildcard=True))
done(c.get_parameters(["a"]))

ask(GetLoggerLevels, "n/get_logger_levels", names=["n", "x.y"])
ask(SetLoggerLevels, "n/set_logger_levels", levels=[LoggerLevel(name="n", level=10), LoggerLevel(name="n", level=11)])
n.get_logger().get_effective_level()
ask(GetLoggerLevels, "n/get_logger_levels", names=["n", "n.child"])

records = []
subscription = asker.create_subscription(Log, "/rosout", lambda m: records.append((m.level, m.name, m.msg, pathlib.Path(m.file).name, m.line > 0)), 10)
spin(lambda: n.count_subscribers("/rosout") and asker.count_publishers("/rosout") == 2)
_ = [executor.spin_once(0.1) for _ in range(5)]
child = n.get_logger().get_child("child")
(n.get_logger().warning("from n"), child.error("from a child"), n.get_logger().debug("details"))
spin(lambda: len([r for r in records if r[1].startswith("n")]) >= 3)
sorted(r for r in records if r[1].startswith("n"))

publisher = n.create_publisher(String, "out", 10, qos_overriding_options=QoSOverridingOptions.with_default_policies())
(publisher.qos_profile.depth, publisher.qos_profile.reliability)
sorted(name for name in n.list_parameters([], 0).names if name.startswith("qos"))
n.get_parameter("qos_overrides./out.publisher.reliability")
n.describe_parameter("qos_overrides./out.publisher.depth")
n.create_subscription(String, "in", print, 10, qos_overriding_options=QoSOverridingOptions([QoSPolicyKind.LIFESPAN, QoSPolicyKind.DEADLINE], entity_id="me")).topic_name
sorted(name for name in n.list_parameters([], 0).names if name.startswith("qos_overrides./in"))
n.create_publisher(String, "bad", 10, qos_overriding_options=QoSOverridingOptions([QoSPolicyKind.HISTORY]))
n.create_publisher(String, "no", 10, qos_overriding_options=QoSOverridingOptions([QoSPolicyKind.DEPTH], callback=lambda q: SetParametersResult(successful=False, reason="no")))
n.create_publisher(String, "unknown", qos_profile_unknown, qos_overriding_options=QoSOverridingOptions([QoSPolicyKind.HISTORY]))

source = TimeSource(node=n)
clock = ROSClock()
(source.attach_clock(clock), source.ros_time_is_active, clock.ros_time_is_active)
source.attach_clock(rclpy.clock.Clock())
TimeSource(node=5)
clocks = asker.create_publisher(Clock, "/clock", 10)
n.set_parameters([Parameter("use_sim_time", value=True)])
(source.ros_time_is_active, clock.ros_time_is_active, clock.now(), n.get_clock().now())
spin(lambda: clocks.get_subscription_count() == 2)
clocks.publish(Clock(clock=rclpy.time.Time(seconds=5).to_msg()))
(spin(lambda: clock.now().nanoseconds), clock.now())
(spin(lambda: n.get_clock().now().nanoseconds), n.get_clock().now())
n.set_parameters([Parameter("use_sim_time", value=False)])
(clock.ros_time_is_active, n.get_clock().now().nanoseconds > 10**18)
source.detach_node()
rclpy.shutdown()
