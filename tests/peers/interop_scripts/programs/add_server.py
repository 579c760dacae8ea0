"""A service, and SIGINT not caught."""

import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool


class Server(Node):
    def __init__(self):
        super().__init__("server")
        self.srv = self.create_service(SetBool, "flip", self.flip)
        print(self.srv.srv_name)

    def flip(self, request, response):
        response.success = not request.data
        response.message = "was %s" % request.data
        self.get_logger().info("Incoming request\ndata: %s" % request.data)
        return response


rclpy.init()
rclpy.spin(Server())
