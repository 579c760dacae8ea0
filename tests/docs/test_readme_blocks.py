"""Every program of the README runs alone, as a newcomer pastes it into a file beside what the README generates."""

from __future__ import annotations

import asyncio
import itertools
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.markdown_pages import ROOT, Block, blocks
from support.node_fixtures import World, domain_id

README = ROOT / "README.md"
SHOWN = [block for block in blocks(README) if not block.hidden]
PROGRAMS = [(one, then) for one, then in itertools.pairwise([*SHOWN, None]) if one and one.language == "python"]
ENVIRONMENT = {
    **{name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "CYCLONEDDS", "AMENT"))},
    "PYTHONPATH": str(ROOT),
    "PYTHONUNBUFFERED": "1",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("newcomer")
    (line,) = [line for block in SHOWN for line in block.text.splitlines() if line.startswith("rosidl-py-gen ")]
    command = [sys.executable, "-m", "rosidl_py_gen.generator_cli", *shlex.split(line)[1:]]
    subprocess.run(command, cwd=made, env=ENVIRONMENT, check=True, capture_output=True)
    return made


def start(folder: Path, block: Block) -> subprocess.Popen[str]:
    (folder / "pasted.py").write_text(block.text, encoding="utf-8")
    environment = {**ENVIRONMENT, "ROS_DOMAIN_ID": str(domain_id())}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "pasted.py"], cwd=folder, env=environment, text=True, **pipes)


def test_there_are_programs_of_both_kinds() -> None:
    ends = [then is not None and then.language == "text" for _, then in PROGRAMS]
    assert ends.count(True) >= 2 and ends.count(False) >= 1


@pytest.mark.parametrize(("block", "then"), PROGRAMS, ids=lambda block: f"line {block.line}" if block else "end")
async def test_a_program_runs_alone(dds: World, folder: Path, block: Block, then: Block | None) -> None:
    running = start(folder, block)
    try:
        if then is None or then.language != "text":  # it goes on until Ctrl-C
            publisher = dds.node("newcomer").create_publisher("std_msgs/msg/String", "chatter")
            loud = dds.nodes[-1].create_subscription("std_msgs/msg/String", "chatter_loud")
            assert await publisher.wait_for_subscribers(20) and await loud.wait_for_publishers(20)
            answer = asyncio.ensure_future(loud.receive(20))
            while not answer.done():  # the program may not know our subscription yet
                publisher.publish({"data": "hello"})
                await asyncio.wait([answer], timeout=0.2)
            assert answer.result()["data"] == "HELLO"
            running.send_signal(signal.SIGINT)
        output, errors = await asyncio.to_thread(running.communicate, timeout=40)
    finally:
        running.kill()
    expected = then.text if then is not None and then.language == "text" else ""
    assert (running.returncode, output) == (0, expected), errors
