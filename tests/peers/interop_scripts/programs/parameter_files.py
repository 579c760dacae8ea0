"""Parameters of files and of the command line, declared by themselves, by prefix, with overrides of the program."""

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file

rclpy.init()
node = Node(
    "driver",
    namespace="robot",
    automatically_declare_parameters_from_overrides=True,
    parameter_overrides=[Parameter("given", Parameter.Type.INTEGER, 7)],
)
for name in sorted(node.get_parameters_by_prefix("")):
    parameter = node.get_parameter(name)
    print(name, parameter.type_.name, parameter.value, type(parameter.value).__name__)
print({name: p.value for name, p in node.get_parameters_by_prefix("wheels").items()})
free = Node("free", allow_undeclared_parameters=True)
print(free.has_parameter("common"), free.get_parameter("common").value, free.get_parameter("nothing").type_.name)
print(free.set_parameters([Parameter("new", value=[1.5])])[0].successful, free.get_parameter("new").value)
print(free.declare_parameter("common", "default").value, free.declare_parameter("rate", 9.0).value)
try:
    Node("refuses").declare_parameter("common", 3)
except Exception as error:
    print(type(error).__name__, error)
print(Node("ignores").declare_parameter("common", 3, ignore_override=True).value)
print(sorted(parameter_dict_from_yaml_file("programs/params.yaml", use_wildcard=True, target_nodes=["/robot/driver"])))
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    print("bye")
