"""A service's callback that raises ends the program; who asked gets no answer."""

import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool


class Fragile(Node):
    def __init__(self):
        super().__init__("fragile")
        self.create_service(SetBool, "divide", self.divide)

    def divide(self, request, response):
        response.success = True
        response.message = str(1 / request.data)
        return response


rclpy.init()
node = Fragile()
try:
    rclpy.spin(node)
finally:
    print("finally", rclpy.ok())
    node.destroy_node()
    rclpy.shutdown()
