"""Parameters that a file sets to an empty list or an empty map, which rcl reads as values that are not set."""
# ruff: noqa
# fmt: off

import tempfile
from pathlib import Path
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rcl_interfaces.msg import ParameterDescriptor

file = Path(tempfile.mkdtemp()) / "p.yaml"
file.write_text("/**:\n  ros__parameters:\n    ints: []\n    texts: []\n    real: []\n    last: {}\n", encoding="utf-8")
_ = rclpy.init(args=["x", "--ros-args", "--params-file", str(file), "-p", "bools:=[]", "-p", "bools:=[]"])
node = Node("show")
node.declare_parameter("ints", [1, 2])
node.has_parameter("ints")
node.get_parameter("ints")
node.get_parameter_or("ints")
node.get_parameter_or("ints", Parameter("ints", value=[5]))
node.get_parameter_type("ints")
node.get_parameter_types(["ints"])
node.get_parameters(["ints"])
node.get_parameters_by_prefix("")["ints"]
node.describe_parameter("ints").type
node.list_parameters([], 0).names
node.declare_parameter("texts", [""], ParameterDescriptor(description="x"))
node.declare_parameter("bools", [True])
node.get_parameter("bools")
node.declare_parameter("real", 1.5)
node.get_parameter("real")
node.declare_parameter("last", "text")
node.get_parameter("last")
node.declare_parameter("last2", "text").value
node.set_parameters([Parameter("ints", value=[])])
node.set_parameters([Parameter("ints", Parameter.Type.INTEGER_ARRAY, [])])
node.get_parameter("ints")
node.set_parameters([Parameter("texts", value=["a"])])
node.get_parameter("texts").value
node.set_parameters([Parameter("bools")])
node.set_parameters([Parameter("bools", value=1)])
node.set_parameters_atomically([Parameter("bools", value=[False])])
node.get_parameter("bools")
node.undeclare_parameter("bools")
node.has_parameter("bools")
node.declare_parameter("bools", [True], ignore_override=True)

other = Node("other")
other.declare_parameters(
    "", [("ints", [1]), ("texts", Parameter.Type.STRING_ARRAY), ("real", 1, ParameterDescriptor(dynamic_typing=True))]
)
other.get_parameter("texts")
other.get_parameter("real")
other.get_parameter_or("real").type_
other.get_parameters(["real", "texts"])
other.declare_parameters("a", [("ints", [1])])
other.get_parameter_type("real")
other.set_parameters([Parameter("real")])
other.has_parameter("real")

allowing = Node("allowing", allow_undeclared_parameters=True)
allowing.has_parameter("ints")
allowing.get_parameter("ints")
allowing.get_parameter_or("ints", Parameter("ints", value=[5]))
allowing.declare_parameter("ints", [1])
allowing.get_parameter("ints")
allowing.set_parameters([Parameter("ints")])
allowing.has_parameter("ints")

Node("declaring", automatically_declare_parameters_from_overrides=True)
own = Node("own", parameter_overrides=[Parameter("ints", value=[3])])
own.declare_parameter("ints", [1]).value
empty = Node(
    "empty",
    parameter_overrides=[Parameter("n"), Parameter("i", Parameter.Type.INTEGER_ARRAY, []), Parameter("b", value=[])],
)
empty.declare_parameter("n", 1)
empty.get_parameter("n")
empty.declare_parameter("i", [1])
empty.declare_parameter("b", [1])

server = Node("server")
server.declare_parameter("ints", [1, 2])
client = AsyncParameterClient(node, "server")
executor = rclpy.executors.SingleThreadedExecutor()
executor.add_node(server)
executor.add_node(node)
client.wait_for_services(10)


def ask(future):
    executor.spin_until_future_complete(future, 10)
    return future.result()


ask(client.get_parameter_types(["ints"])).types
ask(client.get_parameters(["ints"])).values
ask(client.get_parameters(["ints", "use_sim_time"])).values
ask(client.list_parameters([], 0)).result.names
ask(client.describe_parameters(["ints"])).descriptors[0].type
ask(client.set_parameters([Parameter("ints", value=[7])])).results
ask(client.get_parameters(["ints"])).values[0].integer_array_value
