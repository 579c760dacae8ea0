"""Cells of a notebook in an IPython kernel: top-level await, and callbacks between cells."""

from __future__ import annotations

import asyncio
import os
from html import escape
from typing import TYPE_CHECKING, Any

import pytest
from jupyter_client.asynchronous.client import AsyncKernelClient
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from support.browser import browser
from support.docs_pictures import update_picture
from support.folders import ROOT
from support.generated_packages import GENERATED

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable
    from pathlib import Path

    from support.browser import Browser

__all__ = ["browser"]

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
await client.wait_for_service(20)
"""
KERNEL_S = 60.0


class Notebook:
    """IPython kernel that runs cells."""

    def __init__(self, client: AsyncKernelClient) -> None:
        self._client = client
        self.prints: dict[str, str] = {}
        """Cell id -> its output, or functions that it passed in."""
        self.views: dict[str, dict[str, Any]] = {}
        """Cell id -> what it displays, by media type."""

    def _store_output(self, message: dict[str, Any]) -> None:
        if message["msg_type"] == "stream":
            cell = message["parent_header"]["msg_id"]
            self.prints[cell] = self.prints.get(cell, "") + message["content"]["text"]
        elif message["msg_type"] == "execute_result":
            self.views[message["parent_header"]["msg_id"]] = message["content"]["data"]

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
            self._store_output(await self._client.get_iopub_msg(timeout=KERNEL_S))

    async def displayed(self, code: str) -> dict[str, Any]:
        """Run a cell; return what its last expression displays, by media type."""
        cell = await self.cell(code)
        while cell not in self.views:
            self._store_output(await self._client.get_iopub_msg(timeout=KERNEL_S))
        return self.views[cell]


async def in_notebook(folder: Path, use: Callable[[Notebook], Awaitable[None]]) -> None:
    """Start a kernel, use it and shut it down."""
    own = {name: str(folder) for name in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR")}
    environment = {**os.environ, **own, "PYTHONPATH": f"{ROOT}{os.pathsep}{GENERATED.name}"}
    manager = AsyncKernelManager(
        ip="127.0.0.1",
        connection_file=str(folder / "kernel.json"),
        kernel_spec_manager=KernelSpecManager(kernel_dirs=[]),  # only the kernel of this interpreter
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
async def test_node_runs_callbacks_and_calls_between_notebook_cells(tmp_path: Path) -> None:
    async def use(notebook: Notebook) -> None:
        made = await notebook.cell(NODE.format(transport="None"))
        await notebook.cell("response = await client.call(SetBool.Request(data=True), 5)\nassert response.success")
        await notebook.cell("publisher.publish(Int32(data=1))")
        await notebook.printed(made, "heard 1\n")  # printed between two cells, below the cell that passed the function
        await notebook.cell("publisher.publish(Int32(data=2))")
        await notebook.cell("received = [(await subscription.receive(20)).data for _ in range(2)]")
        await notebook.cell("assert received == heard == [1, 2], (received, heard)")
        assert (await notebook.error("client.call_sync(SetBool.Request(), 5)")).startswith(
            "WouldDeadlockError: call_sync of Client(/s, "
        )
        await notebook.cell("assert (await asyncio.to_thread(client.call_sync, SetBool.Request(data=True), 5)).success")
        assert "one runs here already (Jupyter always has one)" in await notebook.error("run(client.call)")
        refused = await notebook.error("asyncio.run(asyncio.sleep(0))")
        assert refused == "RuntimeError: asyncio.run() cannot be called from a running event loop"
        await notebook.cell("assert (await client.call(SetBool.Request(data=True), 20)).success\nnode.context.close()")

    await in_notebook(tmp_path, use)


VIEWS = {
    "cloud": """
x, y = np.meshgrid(np.linspace(-4, 4, 240), np.linspace(-3, 3, 180))
rows = np.zeros(x.size, [(name, np.float32) for name in "xyz"])
rows["x"], rows["y"], rows["z"] = x.ravel(), y.ravel(), (np.sin(x) * np.cos(y)).ravel()
cloud = array_to_pointcloud(rows)
""",
    "imu": "imu = Imu()\nimu.header.frame_id, imu.linear_acceleration.z = 'imu_link', 9.81",
    "bag": """
with BagWriter("drive") as writer:
    for number in range(100):
        writer.write("/imu", imu, number * 10**7)
    writer.write("/points", cloud, 0)
bag = BagReader("drive")
""",
}
PAGE = """<!doctype html><meta charset="utf-8"><style>
body { font: 13px sans-serif; margin: 12px; display: grid; grid-template-columns: auto auto; gap: 4px 24px }
pre { background: #f5f5f5; border: 1px solid #ddd; padding: 6px; margin: 0 0 6px 0 }
table { border-collapse: collapse; font-size: 12px } td, th { padding: 3px 8px }
tr:nth-child(even) { background: #f5f5f5 }
</style>"""


@pytest.mark.timeout(180)
def test_objects_are_displayed_as_html_in_a_notebook(tmp_path: Path, browser: Browser) -> None:
    views: dict[str, str] = {}

    async def use(notebook: Notebook) -> None:
        async def html(code: str) -> str:
            return str((await notebook.displayed(code))["text/html"])

        await notebook.cell("import numpy as np\nfrom sensor_msgs.msg import Imu\nimu = Imu()")
        assert "text/html" not in await notebook.displayed("imu")
        await notebook.cell("%load_ext rosidl_py_gen.numpy")
        await notebook.cell(
            "from rosidl_py_gen.bags import BagReader, BagWriter\nfrom rosidl_py_gen.numpy import array_to_pointcloud"
        )
        for code in VIEWS.values():
            await notebook.cell(code)
        await notebook.cell(NODE.format(transport="MemoryTransport()"))
        views.update({name: await html(name) for name in ("cloud", "imu", "bag", "node")})
        evil = await html("imu.header.frame_id = '<script>'\nimu")
        assert "&lt;script&gt;" in evil and "<script" not in evil
        assert (await notebook.displayed("imu"))["text/plain"].startswith("Imu(header=Header(")
        await notebook.cell("node.context.close()")
        assert "closed" in await html("node")

    asyncio.run(in_notebook(tmp_path, use))
    assert "43200 points from above; x from -4 to 4 m" in views["cloud"]
    for cell in ("/imu", "sensor_msgs/msg/Imu", "100", "/points"):
        assert f">{cell}</td>" in views["bag"]
    for part in (">Publisher</td>", ">/n</td>", "of every node</summary>"):
        assert part in views["node"]
    cells = "".join(f"<div><pre>{escape(name)}</pre>{html}</div>" for name, html in views.items())
    (tmp_path / "page.html").write_text(PAGE + cells, encoding="utf-8")
    browser.resize(1200, 600)
    browser.open((tmp_path / "page.html").as_uri())
    assert browser.run("return document.images[0].complete && document.images[0].naturalWidth") == 480
    assert browser.run("return [...document.querySelectorAll('details')].filter(one => one.open).length") == 1
    browser.run("document.querySelector('details[open] details').open = true")
    text = browser.run("return document.body.innerText")
    assert "imu_link" in text and "frame_id" in text and "keep last 10" in text
    browser.resize(1200, browser.run("return document.documentElement.scrollHeight"))
    update_picture("notebook_views.png", browser.screenshot())
