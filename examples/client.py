"""Ask a service three things at once: python examples/client.py 40, while service.py runs in another terminal.

Seen: ``40 + 1 = 41`` and two more. Where no service is, CallTimeoutError after ten seconds.
"""

import asyncio
import sys

from example_interfaces.srv import AddTwoInts

from rosidl_py_gen.runtime import Node, run


async def main() -> None:
    a = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    async with Node("asker") as node:
        client = node.create_client(AddTwoInts, "add_two_ints")
        requests = [AddTwoInts.Request(a=a, b=b) for b in (1, 2, 3)]
        responses = await asyncio.gather(*(client.call(request, timeout_s=10) for request in requests))
        for request, response in zip(requests, responses, strict=True):
            print(f"{request.a} + {request.b} = {response.sum}", flush=True)


run(main)
