"""The listener again, with a callback: python examples/listener_callbacks.py, stop with Ctrl-C.

Seen, while talker.py runs in another terminal: ``I heard: Hello World: 3`` twice a second.
"""

from std_msgs.msg import String

from rosidl_py_gen.runtime import Node, spin


def on_message(message: String) -> None:
    print(f"I heard: {message.data}", flush=True)


node = Node("listener")
node.create_subscription(String, "chatter", on_message)
spin(node)
