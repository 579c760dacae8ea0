"""Print what the talker says. Stop with Ctrl-C."""

from std_msgs.msg import String

from rosidl_py_gen.runtime import Node, run


async def main() -> None:
    async with Node("listener") as node:
        async for message in node.create_subscription(String, "chatter"):
            print(f"I heard: {message.data}", flush=True)


run(main)
