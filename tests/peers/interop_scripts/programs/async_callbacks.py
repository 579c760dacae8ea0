"""A service whose callback is a coroutine and awaits another service, in one thread."""

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import SetBool


class Doubling(Node):
    def __init__(self):
        super().__init__("doubling")
        group = ReentrantCallbackGroup()
        self.inner = self.create_service(SetBool, "inner", self.add, callback_group=group)
        self.client = self.create_client(SetBool, "inner", callback_group=group)
        self.outer = self.create_service(SetBool, "double", self.double, callback_group=group)

    def add(self, request, response):
        response.success, response.message = request.data, "inner"
        return response

    async def double(self, request, response):
        answer = await self.client.call_async(SetBool.Request(data=not request.data))
        print("awaited", answer.success, answer.message, flush=True)
        response.success, response.message = answer.success, "outer " + answer.message
        return response


rclpy.init()
node = Doubling()
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
