"""A timer's callback that spins until its own service call is answered: by another node, and by another group."""

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from std_srvs.srv import Trigger


class Asker(Node):
    def __init__(self):
        super().__init__("asker")
        self.cli = self.create_client(Trigger, "answer", callback_group=MutuallyExclusiveCallbackGroup())
        self.held = self.create_client(Trigger, "answer")
        self.create_service(Trigger, "answer", self.answer, callback_group=MutuallyExclusiveCallbackGroup())
        self.timer = self.create_timer(0.05, self.tick)
        self.done = False

    def answer(self, request, response):
        response.success = True
        return response

    def tick(self):
        self.timer.cancel()
        while not self.cli.wait_for_service(timeout_sec=1.0):
            self.get_logger().info("service not available, waiting again...")
        future = self.cli.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(self, future, timeout_sec=5)
        print("nested", future.done(), future.result())
        future = self.held.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(self, future, timeout_sec=0.3)
        print("same group", future.done())
        self.done = True


rclpy.init()
asker = Asker()
while not asker.done:
    rclpy.spin_once(asker)
print("still there", asker.executor is not None)
asker.destroy_node()
rclpy.shutdown()
