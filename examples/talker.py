"""Publish a greeting twice a second: python examples/talker.py, stop with Ctrl-C.

Seen: ``publishing: Hello World: 1`` and so on, whether or not listener.py runs.
"""

from std_msgs.msg import String

from rosidl_py_gen.runtime import Node, run


async def main() -> None:
    async with Node("talker") as node:
        publisher = node.create_publisher(String, "chatter")
        timer = node.create_timer(0.5)
        count = 0
        async for _ in timer:
            count += 1
            publisher.publish(String(data=f"Hello World: {count}"))
            print(f"publishing: Hello World: {count}", flush=True)


run(main)
