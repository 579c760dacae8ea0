"""Many threads: each with a node and an executor, publishing to each other, and one that spins for all."""

import threading

import rclpy
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Int32

rclpy.init()

def spin(executor):
    try:
        executor.spin()
    except AttributeError:
        pass  # real rclpy's, when shutdown in another thread comes between two looks


class Worker(Node):
    def __init__(self, number):
        super().__init__(f"worker_{number}")
        self.lock = threading.Lock()
        self.seen = []
        self.pub = self.create_publisher(Int32, "numbers", 50)
        self.sub = self.create_subscription(Int32, "numbers", self.on, 50)

    def on(self, msg):
        with self.lock:
            self.seen.append(msg.data)


workers = [Worker(number) for number in range(3)]
executors = []
for worker in workers:
    executor = SingleThreadedExecutor()
    executor.add_node(worker)
    executors.append(executor)
threads = [threading.Thread(target=spin, args=(executor,), daemon=True) for executor in executors]
for thread in threads:
    thread.start()
alone = threading.Event()
for worker in workers:
    while worker.pub.get_subscription_count() < 3:
        alone.wait(0.01)


def publish(worker, start):
    for number in range(start, start + 10):
        worker.pub.publish(Int32(data=number))


publishing = [threading.Thread(target=publish, args=(worker, 10 * n)) for n, worker in enumerate(workers)]
for thread in publishing:
    thread.start()
for thread in publishing:
    thread.join()
while any(len(worker.seen) < 30 for worker in workers):
    alone.wait(0.01)
for executor in executors:
    executor.shutdown()
for thread in threads:
    thread.join()
print([sorted(worker.seen) == list(range(30)) for worker in workers])
for start in (0, 10, 20):
    print([[n for n in worker.seen if start <= n < start + 10] == list(range(start, start + 10)) for worker in workers])
together = MultiThreadedExecutor(num_threads=4)
for worker in workers:
    worker.seen.clear()
    together.add_node(worker)
thread = threading.Thread(target=spin, args=(together,), daemon=True)
thread.start()
publish(workers[0], 0)
while any(len(worker.seen) < 10 for worker in workers):
    alone.wait(0.01)
late = Worker(9)
together.add_node(late)
while late.pub.get_subscription_count() < 4:
    alone.wait(0.01)
late.pub.publish(Int32(data=99))
while 99 not in late.seen:
    alone.wait(0.01)
print(late.seen, len(together.get_nodes()))
together.shutdown(5)  # at times a thread of real rclpy stays under load
thread.join(5)
rclpy.shutdown()
print("ended")
