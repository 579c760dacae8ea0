"""Add two integers for whoever asks: python examples/service.py, stop with Ctrl-C.

Requests are handled at the same time. Seen, once client.py asks: ``request: 40 + 1``.
"""

import asyncio

from example_interfaces.srv import AddTwoInts

from rosidl_py_gen.runtime import Node, run


async def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    print(f"request: {request.a} + {request.b}", flush=True)
    await asyncio.sleep(0.1)  # something that takes its time
    return AddTwoInts.Response(sum=request.a + request.b)


async def main() -> None:
    async with Node("adder") as node:
        node.create_service(AddTwoInts, "add_two_ints", add)
        await asyncio.Event().wait()


run(main)
