"""A service that calls another service of the same node, blocking, in a MultiThreadedExecutor; in every kind of group."""

import threading

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

def spin(executor):
    try:
        executor.spin()
    except AttributeError:
        pass  # real rclpy's, when shutdown in another thread comes between two looks


class Chain(Node):
    def __init__(self):
        super().__init__("chain")
        self.cbg_clients = MutuallyExclusiveCallbackGroup()
        self.cbg_reentrant = ReentrantCallbackGroup()
        self.inner = self.create_service(SetBool, "inner", self.on_inner)
        self.outer = self.create_service(Trigger, "outer", self.on_outer, callback_group=self.cbg_reentrant)
        self.client = self.create_client(SetBool, "inner", callback_group=self.cbg_clients)
        self.depth = 0

    def on_inner(self, request, response):
        response.success = request.data
        response.message = "inner"
        return response

    def on_outer(self, request, response):
        self.depth += 1
        self.client.wait_for_service()
        answer = self.client.call(SetBool.Request(data=True))
        response.success = answer.success
        response.message = "outer of " + answer.message
        return response


rclpy.init()
node = Chain()
caller = rclpy.create_node("caller")
executor = MultiThreadedExecutor(num_threads=8)
executor.add_node(node)
thread = threading.Thread(target=spin, args=(executor,), daemon=True)
thread.start()
client = caller.create_client(Trigger, "outer")
client.wait_for_service()
futures = [client.call_async(Trigger.Request()) for _ in range(3)]
for future in futures:
    rclpy.spin_until_future_complete(caller, future, timeout_sec=10)
    print(future.result())
print(node.depth)
print(client.call(Trigger.Request(), timeout_sec=0.2))  # nobody spins for the caller
caller2 = rclpy.create_node("caller2", use_global_arguments=False)
executor.add_node(caller2)
second = caller2.create_client(Trigger, "outer")
second.wait_for_service()
print(second.call(Trigger.Request(), timeout_sec=10))
executor.shutdown()
thread.join()
print(executor.get_nodes())
rclpy.shutdown()
