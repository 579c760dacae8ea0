"""Every program of the README runs alone, in a file next to the packages that the README generates."""

from __future__ import annotations

import asyncio
import itertools
import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.folders import ROOT
from support.local_network import domain_id
from support.markdown_pages import Block, blocks
from support.worlds import World

from rosidl_py_gen.runtime import SENSOR_DATA

README = ROOT / "README.md"
SHOWN = blocks(README)
PROGRAMS = [
    (one, following_block)
    for one, following_block in itertools.pairwise([*SHOWN, None])
    if one and one.language == "python"
]
ENVIRONMENT = {
    **{name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "CYCLONEDDS", "AMENT"))},
    "PYTHONPATH": str(ROOT),
    "PYTHONUNBUFFERED": "1",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the packages that the README generates."""
    made = tmp_path_factory.mktemp("newcomer")
    parts = [part.strip() for block in SHOWN if block.language == "sh" for part in re.split(r"&&|\n", block.text)]
    (arguments,) = [shlex.split(part)[1:] for part in parts if part.startswith("rosidl-py-gen ") and "--out" in part]
    command = [sys.executable, "-m", "rosidl_py_gen.generator_cli", *arguments]
    subprocess.run(command, cwd=made, env=ENVIRONMENT, check=True, capture_output=True)
    return made / arguments[arguments.index("--out") + 1]


def start(packages: Path, block: Block) -> subprocess.Popen[str]:
    program = packages.parent / "pasted.py"
    program.write_text(block.text, encoding="utf-8")
    paths = os.pathsep.join([str(packages), str(ROOT)])
    environment = {**ENVIRONMENT, "PYTHONPATH": paths, "ROS_DOMAIN_ID": str(domain_id())}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, program], cwd=packages.parent, env=environment, text=True, **pipes)


def test_readme_has_programs_of_each_kind() -> None:
    assert [kind_of(block, following_block) for block, following_block in PROGRAMS] == ["reads", "relays", "prints"]


def kind_of(block: Block, following_block: Block | None) -> str:
    """Return what the program needs: a message of /scan, messages of /chatter until Ctrl-C, or nothing."""
    if "/scan" in block.text:
        return "reads"
    return "prints" if following_block is not None and following_block.language == "text" else "relays"


async def relay(dds: World) -> None:
    publisher = dds.node("newcomer").create_publisher("std_msgs/msg/String", "chatter")
    loud = dds.nodes[-1].create_subscription("std_msgs/msg/String", "chatter_loud")
    assert await publisher.wait_for_subscribers(20) and await loud.wait_for_publishers(20)
    answer = asyncio.ensure_future(loud.receive(20))
    while not answer.done():  # the program may not know our subscription yet
        publisher.publish({"data": "hello"})
        await asyncio.wait([answer], timeout=0.2)
    assert answer.result()["data"] == "HELLO"


@pytest.mark.parametrize(
    ("block", "following_block"), PROGRAMS, ids=lambda block: f"line {block.line}" if block else "end"
)
async def test_readme_program_runs_alone(dds: World, folder: Path, block: Block, following_block: Block | None) -> None:
    kind, expected = (
        kind_of(block, following_block),
        following_block.text if following_block is not None and following_block.language == "text" else "",
    )
    running = start(folder, block)
    try:
        if kind == "relays":
            await relay(dds)
            running.send_signal(signal.SIGINT)
        ended = asyncio.ensure_future(asyncio.to_thread(running.communicate, timeout=40))
        if kind == "reads":
            publisher = dds.node("lidar").create_publisher("sensor_msgs/msg/LaserScan", "/scan", SENSOR_DATA)
            while not ended.done():
                publisher.publish({"header": {"frame_id": "laser"}})
                await asyncio.wait([ended], timeout=0.2)
        output, errors = await ended
    finally:
        running.kill()
    assert running.returncode == 0, errors
    assert "'frame_id': 'laser'" in output if kind == "reads" else output == expected, errors
