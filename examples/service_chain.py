"""A service that calls two others in its handler: python examples/service_chain.py

Is the robot ready? It is when battery and camera say so; both are asked at the same time. All nodes share one process,
one thread and one event loop, and nothing blocks: a handler may await whatever it needs. The camera then goes away,
and what the robot does not hear within two seconds becomes part of its answer. Messages:
rosidl-py-gen --install. Seen:

    ready: battery: 87 %; camera: 30 frames/s
    not ready: battery: 87 %; camera: no answer within 2 s
"""

import asyncio

from std_srvs.srv import Trigger

from rosidl_py_gen.runtime import CallTimeoutError, Node, run


def battery_check(_: Trigger.Request) -> Trigger.Response:
    return Trigger.Response(success=True, message="87 %")


async def camera_check(_: Trigger.Request) -> Trigger.Response:
    await asyncio.sleep(0.1)  # takes its pictures
    return Trigger.Response(success=True, message="30 frames/s")


class Robot:
    """Serves `ready`, and is a client itself."""

    def __init__(self, node: Node, parts: list[str]) -> None:
        self.checks = {part: node.create_client(Trigger, f"{part}/check") for part in parts}
        node.create_service(Trigger, "ready", self.ready)

    async def ready(self, _: Trigger.Request) -> Trigger.Response:
        answers = await asyncio.gather(*(self.check(part) for part in self.checks))
        return Trigger.Response(
            success=all(answer.success for answer in answers),
            message="; ".join(f"{part}: {answer.message}" for part, answer in zip(self.checks, answers, strict=True)),
        )

    async def check(self, part: str) -> Trigger.Response:
        try:
            return await self.checks[part].call(Trigger.Request(), timeout_s=2.0)
        except CallTimeoutError:  # an error that leaves a handler is logged, and its caller gets no answer at all
            return Trigger.Response(success=False, message="no answer within 2 s")


async def main() -> None:
    async with Node("battery") as battery, Node("camera") as camera, Node("robot") as robot, Node("asker") as asker:
        battery.create_service(Trigger, "battery/check", battery_check)
        camera.create_service(Trigger, "camera/check", camera_check)
        Robot(robot, ["battery", "camera"])

        ready = asker.create_client(Trigger, "ready")
        for _ in range(2):
            answer = await ready.call(Trigger.Request(), timeout_s=10)
            print("ready:" if answer.success else "not ready:", answer.message, flush=True)
            camera.close()


run(main)
