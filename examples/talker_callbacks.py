"""The talker again, with callbacks instead of async functions: python examples/talker_callbacks.py, stop with Ctrl-C.

Seen: ``publishing: Hello World: 1`` and so on, whether or not listener.py runs.
"""

from std_msgs.msg import String

from rosidl_py_gen.runtime import Node, spin


class Talker:
    """Counts while it talks."""

    def __init__(self, node: Node) -> None:
        self.count = 0
        self.publisher = node.create_publisher(String, "chatter")
        node.create_timer(0.5, self.on_timer)

    def on_timer(self) -> None:
        self.count += 1
        self.publisher.publish(String(data=f"Hello World: {self.count}"))
        print(f"publishing: Hello World: {self.count}", flush=True)


node = Node("talker")
talker = Talker(node)
spin(node)
