"""Callbacks before, at and after changes; events of parameters; a client of the parameters of another node."""

import rclpy
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterDescriptor, ParameterType, SetParametersResult
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.parameter_event_handler import ParameterEventHandler

rclpy.init()
node = rclpy.create_node("configured", namespace="robot")
watcher = rclpy.create_node("watcher")
executor = SingleThreadedExecutor()
executor.add_node(node)
executor.add_node(watcher)
handler = ParameterEventHandler(watcher)
seen, events = [], []
handle = handler.add_parameter_callback(
    "speed", "/robot/configured", lambda p: seen.append((p.name, parameter_value_to_python(p.value)))
)
handler.add_parameter_event_callback(
    lambda e: events.append((e.node, [p.name for p in e.new_parameters], [p.name for p in e.changed_parameters],
                             [p.name for p in e.deleted_parameters]))
)


def until(condition):
    for _ in range(200):
        if condition():
            return
        executor.spin_once(timeout_sec=0.1)
    print("never")


client = AsyncParameterClient(watcher, "/robot/configured")
print(client.wait_for_services(timeout_sec=10), client.services_are_ready())
until(lambda: watcher.count_publishers("/parameter_events") == 2)
until(lambda: node.count_subscribers("/parameter_events") == 1)
node.add_pre_set_parameters_callback(lambda ps: [*ps, Parameter("count", value=len(ps))])
node.add_on_set_parameters_callback(
    lambda ps: SetParametersResult(successful=all(p.value != "bad" for p in ps), reason="no bad ones")
)
node.add_post_set_parameters_callback(lambda ps: print("post", [(p.name, p.value) for p in ps]))
node.declare_parameter("count", 0)
node.declare_parameter("speed", 1.0)
node.declare_parameter("word", "good", ParameterDescriptor(description="a word"))
until(lambda: len([e for e in events if "word" in e[1]]) == 1)


def ask(future):
    executor.spin_until_future_complete(future, timeout_sec=10)
    return future.result()


print([(r.successful, r.reason) for r in node.set_parameters([Parameter("speed", Parameter.Type.DOUBLE, 2.5)])])
print([(r.successful, r.reason) for r in node.set_parameters([Parameter("word", value="bad")])])
print(ask(client.set_parameters([Parameter("speed", value=3.5), Parameter("word", value="bad")])))
print(ask(client.set_parameters_atomically([Parameter("speed", value=4.5), Parameter("word", value="fine")])))
print([r.successful for r in ask(client.set_parameters([ParameterMsg(name="nothing")])).results])
print([parameter_value_to_python(v) for v in ask(client.get_parameters(["speed", "word", "count"])).values])
print(list(ask(client.get_parameter_types(["speed", "word"])).types), ParameterType.PARAMETER_DOUBLE)
print([d.description for d in ask(client.describe_parameters(["word"])).descriptors])
print(sorted(ask(client.list_parameters(["speed"], 1)).result.names))
node.undeclare_parameter("speed")
until(lambda: len(seen) == 4)
print(seen)
print(events)
handler.remove_parameter_callback(handle)
try:
    handler.remove_parameter_callback(handle)
except Exception as error:
    print(type(error).__name__)
executor.shutdown()
rclpy.shutdown()
