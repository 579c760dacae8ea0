"""The client again, in a plain script without any event loop: python examples/client_sync.py, while service.py runs.

Seen: ``40 + 2 = 42``.
"""

from example_interfaces.srv import AddTwoInts

from rosidl_py_gen.runtime import Node

with Node("asker") as node:
    client = node.create_client(AddTwoInts, "add_two_ints")
    response = client.call_sync(AddTwoInts.Request(a=40, b=2), timeout_s=10)
    print(f"40 + 2 = {response.sum}", flush=True)
