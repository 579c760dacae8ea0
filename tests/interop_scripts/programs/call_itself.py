"""Services called inside of callbacks: a nested spin with another group, and a blocking call in a thread."""

import threading

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool

def spin(executor):
    try:
        executor.spin()
    except AttributeError:
        pass  # real rclpy's, when shutdown in another thread comes between two looks


class Both(Node):
    def __init__(self):
        super().__init__("both")
        self.group = ReentrantCallbackGroup()
        self.other = MutuallyExclusiveCallbackGroup()
        self.server = self.create_service(SetBool, "sum", self.answer, callback_group=self.other)
        self.client = self.create_client(SetBool, "sum", callback_group=self.group)
        self.timer = self.create_timer(0.05, self.ask, callback_group=self.group)
        self.asked = False
        self.done = threading.Event()

    def answer(self, request, response):
        response.success, response.message = request.data, f"got {request.data}"
        return response

    def ask(self):
        if self.asked:
            return
        self.asked = True
        while not self.client.wait_for_service(timeout_sec=1.0):
            print("waiting")
        print("blocking", self.client.call(SetBool.Request(data=True)).message)
        future = self.client.call_async(SetBool.Request(data=False))
        future.add_done_callback(lambda f: (print("callback", f.result().message), self.done.set()))


def main():
    rclpy.init()
    node = Both()
    executor = MultiThreadedExecutor(num_threads=4)
    executor.add_node(node)
    thread = threading.Thread(target=spin, args=(executor,), daemon=True)
    thread.start()
    print("done", node.done.wait(20))
    executor.shutdown()
    thread.join()
    node.destroy_node()

    node = Node("alone")
    client = node.create_client(SetBool, "nobody")
    print("ready", client.service_is_ready(), client.wait_for_service(timeout_sec=0.1))
    future = client.call_async(SetBool.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=0.2)
    print(future.done(), future.result(), future.cancelled())
    client.remove_pending_request(future)
    try:
        client.call_async("text")
    except TypeError:
        print("TypeError")
    rclpy.shutdown()


main()
