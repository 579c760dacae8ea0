"""Declared parameters, descriptors, a callback and overrides."""

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter


class Configured(Node):
    def __init__(self):
        super().__init__("configured")
        self.declare_parameter("rate", 10.0)
        limits = IntegerRange(from_value=0, to_value=10, step=2)
        self.declare_parameter("limited", 4, ParameterDescriptor(description="even", integer_range=[limits]))
        self.declare_parameter("fixed", "value", ParameterDescriptor(read_only=True))
        wide = FloatingPointRange(from_value=0.0, to_value=1.0, step=0.0)
        self.declare_parameters(
            "group", [("one", 0.5, ParameterDescriptor(floating_point_range=[wide])), ("two", [1, 2, 3])]
        )
        self.declare_parameter("names", ["x"])
        self.declare_parameter("later", Parameter.Type.STRING)
        self.declare_parameter("refused", False)
        self.declare_parameter("any", 1, ParameterDescriptor(dynamic_typing=True))
        self.add_on_set_parameters_callback(self.check)
        for name in ("rate", "limited", "fixed", "names", "group.two"):
            parameter = self.get_parameter(name)
            print(name, parameter.type_, parameter.value)

    def check(self, parameters):
        for parameter in parameters:
            print("asked", parameter.name, parameter.value)
            if parameter.name == "refused":
                return SetParametersResult(successful=False, reason="never")
        return SetParametersResult(successful=True)


rclpy.init()
node = Configured()
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
