"""Clients whose server is not there, comes later, is slow, or raises."""

import threading
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import SetBool, Trigger

rclpy.init()
node = rclpy.create_node("asks")
client = node.create_client(Trigger, "work")
print(client.service_is_ready(), client.wait_for_service(timeout_sec=0.05), client.srv_name)
lost = client.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, lost, timeout_sec=0.05)
print(lost.done(), client.remove_pending_request(lost))
lost.cancel()
print(lost.cancelled(), lost.done(), lost.result())


def work(request, response):
    response.success = True
    response.message = "worked"
    return response


servers = rclpy.create_node("serves")
executor = SingleThreadedExecutor()
executor.add_node(servers)
servers.create_service(Trigger, "work", work)
servers.create_service(SetBool, "slow", lambda request, response: time.sleep(0.3) or response)  # longer than calls wait


def broken(request, response):
    if request.data:
        return None
    raise ArithmeticError("broken")


servers.create_service(SetBool, "broken", broken)
errors = []


def serve():
    while rclpy.ok() and len(errors) < 2:
        try:
            executor.spin_once(timeout_sec=0.1)
        except (ArithmeticError, TypeError) as error:
            errors.append(type(error).__name__)


thread = threading.Thread(target=serve)
thread.start()
print(client.wait_for_service(timeout_sec=5.0))
future = client.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, future)
print(future.result())
slow = node.create_client(SetBool, "slow")
slow.wait_for_service()
future = slow.call_async(SetBool.Request())
rclpy.spin_until_future_complete(node, future, timeout_sec=0.05)
print("slow", future.done())
rclpy.spin_until_future_complete(node, future)
print("slow", future.done(), future.result().success)
failing = node.create_client(SetBool, "broken")
failing.wait_for_service()
for data in (False, True):
    future = failing.call_async(SetBool.Request(data=data))
    rclpy.spin_until_future_complete(node, future, timeout_sec=0.3)
    print("broken", future.done())
thread.join()
print(errors)
try:
    print(rclpy.create_node("no_executor").create_client(Trigger, "work").call("text"))
except TypeError:
    print("TypeError")
print(node.destroy_client(client), node.destroy_client(client))
try:
    client.call_async(Trigger.Request())
except Exception as error:
    print(type(error).__name__)
rclpy.shutdown()
