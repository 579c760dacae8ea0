"""Simulated time at ten times the normal speed: python examples/sim_time.py, stop with Ctrl-C.

Published by one node, followed by another. Seen: ``simulated time: 7.0 s`` ten times a second. Other programs follow,
too: python examples/talker_callbacks.py --ros-args -p use_sim_time:=true
"""

from rosidl_py_gen.runtime import Node, run


async def main() -> None:
    async with Node("simulator") as simulator, Node("follower", parameter_overrides={"use_sim_time": True}) as node:
        simulator.create_sim_time_publisher(rate=10.0)
        rate = node.create_rate(1.0)
        while True:
            await rate.sleep()  # one simulated second, 0.1 real ones
            print(f"simulated time: {node.clock.now().nanoseconds / 1e9:.1f} s", flush=True)


run(main)
