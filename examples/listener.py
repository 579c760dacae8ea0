"""Print what the talker says: python examples/listener.py, while talker.py runs in another terminal; stop with Ctrl-C.

Seen: ``I heard: Hello World: 3`` twice a second.
"""

from std_msgs.msg import String

from rosidl_py_gen.runtime import Node, run


async def main() -> None:
    async with Node("listener") as node:
        async for message in node.create_subscription(String, "chatter"):
            print(f"I heard: {message.data}", flush=True)


run(main)
