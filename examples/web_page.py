"""A topic as a live number and plot in the browser, with asyncio alone: python examples/web_page.py

Then open http://127.0.0.1:8765; other machines cannot. A wave is shown, which the program publishes itself, or a topic
of any type and one of its fields: python examples/web_page.py /imu angular_velocity.z. Seen:

    /wave data at http://127.0.0.1:8765, stop with Ctrl-C

Each browser gets a subscription of its own that keeps the newest message only: a slow one misses some, none waits.
"""

import asyncio
import math
import os
import sys
from asyncio import StreamReader, StreamWriter
from contextlib import closing
from operator import attrgetter
from pathlib import Path
from time import monotonic

from std_msgs.msg import Float64

from rosidl_py_gen import Message
from rosidl_py_gen.runtime import Node, run
from rosidl_py_gen.runtime.qos import BEST_AVAILABLE

PAGE = Path(__file__).with_suffix(".html")
PORT = int(os.environ.get("PORT", "8765"))


class LivePage:
    """Answers browsers: the page at /, its values at /values as server-sent events."""

    def __init__(self, node: Node, message_type: type[Message], topic: str, field: str) -> None:
        self.node, self.type, self.topic, self.field = node, message_type, topic, field
        self.value = attrgetter(field)

    async def answer(self, reader: StreamReader, writer: StreamWriter) -> None:
        try:
            request = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), timeout=5)
            _, path, _ = request.split(b" ", 2)
            if path == b"/values":
                await self.send_values(writer)
            elif path == b"/":
                self.head(writer, "200 OK", "text/html; charset=utf-8")
                writer.write(PAGE.read_bytes().replace(b"TITLE", f"{self.topic} {self.field}".encode()))
            else:
                self.head(writer, "404 Not Found", "text/plain")
        except (OSError, EOFError, ValueError, asyncio.LimitOverrunError, asyncio.TimeoutError, asyncio.CancelledError):
            pass  # the browser has gone, or is none; or the program ends, which asyncio logs before CPython 3.12
        finally:
            writer.close()

    def head(self, writer: StreamWriter, status: str, kind: str) -> None:
        writer.write(f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nConnection: close\r\n\r\n".encode())

    async def send_values(self, writer: StreamWriter) -> None:
        self.head(writer, "200 OK", "text/event-stream")
        newest = BEST_AVAILABLE.keep_last(1)
        with closing(self.node.create_subscription(self.type, self.topic, qos=newest)) as subscription:
            async for message in subscription:
                writer.write(f"data: {self.value(message)}\n\n".encode())
                await writer.drain()
                await asyncio.sleep(0.05)  # messages meanwhile are not shown


async def main() -> None:
    topic, field = sys.argv[1:3] if len(sys.argv) > 2 else ("/wave", "data")
    async with Node("web_page") as node:
        if topic == "/wave":
            wave = node.create_publisher(Float64, topic)
            node.create_timer(0.02, lambda: wave.publish(Float64(data=math.sin(monotonic()))))
        page = LivePage(node, await node.resolve_type(topic, timeout_s=20), topic, field)
        async with await asyncio.start_server(page.answer, "127.0.0.1", PORT) as server:
            host, port = server.sockets[0].getsockname()
            print(f"{topic} {field} at http://{host}:{port}, stop with Ctrl-C", flush=True)
            await server.serve_forever()


run(main)
