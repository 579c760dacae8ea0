"""The service again, with a plain function: python examples/service_callbacks.py, stop with Ctrl-C.

Seen, once client.py asks: ``request: 40 + 1``.
"""

from example_interfaces.srv import AddTwoInts

from rosidl_py_gen.runtime import Node, spin


def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
    print(f"request: {request.a} + {request.b}", flush=True)
    return AddTwoInts.Response(sum=request.a + request.b)


node = Node("adder")
node.create_service(AddTwoInts, "add_two_ints", add)
spin(node)
