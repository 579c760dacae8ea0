"""Cells of a notebook in an IPython kernel: top-level await, and callbacks between cells."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import pytest
from jupyter_client.asynchronous.client import AsyncKernelClient
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from support.node_fixtures import GENERATED, ROOT

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable
    from pathlib import Path

NODE = """
import asyncio
from std_msgs.msg import Int32
from std_srvs.srv import SetBool
from rosidl_py_gen.runtime import Context, MemoryTransport, Node, run

node = Node("notebook", context=Context(transport={transport}, args=[]))
heard = []

def hear(message):
    heard.append(message.data)
    print("heard", message.data)

node.create_subscription(Int32, "n", hear)
subscription = node.create_subscription(Int32, "n")
publisher = node.create_publisher(Int32, "n")
node.create_service(SetBool, "s", lambda request: SetBool.Response(success=request.data))
client = node.create_client(SetBool, "s")
await publisher.wait_for_subscribers(5, count=2)
await client.wait_for_service(5)
"""
KERNEL_S = 20.0


class Notebook:
    """IPython kernel that runs cells."""

    def __init__(self, client: AsyncKernelClient) -> None:
        self._client = client
        self.prints: dict[str, str] = {}
        """Cell id -> its output, or functions that it passed in."""

    def _look(self, message: dict[str, Any]) -> None:
        if message["msg_type"] == "stream":
            cell = message["parent_header"]["msg_id"]
            self.prints[cell] = self.prints.get(cell, "") + message["content"]["text"]

    async def cell(self, code: str) -> str:
        """Run a cell that must succeed; return its id."""
        cell, content = await self._run(code)
        assert content["status"] == "ok", "\n".join(content["traceback"])
        return cell

    async def error(self, code: str) -> str:
        """Run a cell that must fail; return the error's name and text."""
        _, content = await self._run(code)
        assert content["status"] == "error"
        return f"{content['ename']}: {content['evalue']}"

    async def _run(self, code: str) -> tuple[str, dict[str, Any]]:
        cell = self._client.execute(code, allow_stdin=False, stop_on_error=False)
        reply: dict[str, Any] = {}
        while reply.get("parent_header", {}).get("msg_id") != cell:
            reply = await self._client.get_shell_msg(timeout=KERNEL_S)
        return cell, reply["content"]

    async def printed(self, cell: str, text: str) -> None:
        """Wait until a cell's output is a text."""
        while self.prints.get(cell) != text:
            self._look(await self._client.get_iopub_msg(timeout=KERNEL_S))


async def in_notebook(folder: Path, use: Callable[[Notebook], Awaitable[None]]) -> None:
    """Start a kernel, use it, and end it."""
    own = {name: str(folder) for name in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR")}
    environment = {**os.environ, **own, "PYTHONPATH": f"{ROOT}{os.pathsep}{GENERATED.name}"}
    manager = AsyncKernelManager(
        ip="127.0.0.1",
        connection_file=str(folder / "kernel.json"),
        kernel_spec_manager=KernelSpecManager(kernel_dirs=[]),  # this interpreter's, whatever others are installed
    )
    try:
        await manager.start_kernel(env=environment, cwd=str(folder))
        client = manager.client()
        client.start_channels()
        try:
            await client.wait_for_ready(timeout=KERNEL_S)
            await use(Notebook(client))
        finally:
            client.stop_channels()
    finally:
        await manager.shutdown_kernel(now=True)


@pytest.mark.timeout(180)
@pytest.mark.parametrize("transport", ["MemoryTransport()", "None"], ids=["memory", "dds"])
async def test_a_node_lives_in_a_notebook(tmp_path: Path, transport: str) -> None:
    async def use(notebook: Notebook) -> None:
        made = await notebook.cell(NODE.format(transport=transport))
        await notebook.cell("response = await client.call(SetBool.Request(data=True), 5)\nassert response.success")
        await notebook.cell("publisher.publish(Int32(data=1))")
        await notebook.printed(made, "heard 1\n")  # between two cells, below the one that handed the function in
        await notebook.cell("publisher.publish(Int32(data=2))")
        await notebook.cell("received = [(await subscription.receive(5)).data for _ in range(2)]")
        await notebook.cell("assert received == heard == [1, 2], (received, heard)")
        assert (await notebook.error("client.call_sync(SetBool.Request(), 5)")).startswith(
            "WouldDeadlockError: call_sync of Client(/s, "
        )
        await notebook.cell("assert (await asyncio.to_thread(client.call_sync, SetBool.Request(data=True), 5)).success")
        assert "one runs here already (Jupyter always has one)" in await notebook.error("run(client.call)")
        refused = await notebook.error("asyncio.run(asyncio.sleep(0))")
        assert refused == "RuntimeError: asyncio.run() cannot be called from a running event loop"
        await notebook.cell("assert (await client.call(SetBool.Request(data=True), 5)).success\nnode.context.close()")

    await in_notebook(tmp_path, use)
