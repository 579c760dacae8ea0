"""``rosidl-py-gen diff`` with a node of rclpy, which describes the types of its topics."""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
from pathlib import Path

import pytest
from peer_helpers import fresh, without_definitions
from rclpy_peer import Peer
from support.node_fixtures import ROOT, start_process


@pytest.mark.only_with("jazzy", "kilted")
async def test_a_robot_of_rclpy_is_compared_with_a_workspace(shared_peer: Peer, tmp_path: Path) -> None:
    topic = fresh("compared")
    await shared_peer.do("publisher", topic=topic, type="test_msgs/msg/BasicTypes")
    for kind in ("msg", "srv", "action"):
        shutil.copytree(ROOT / "tests/interfaces/test_msgs" / kind, tmp_path / "test_msgs" / kind)
    changed = tmp_path / "test_msgs/msg/BasicTypes.msg"
    changed.write_text(changed.read_text().replace("int16 int16_value", "uint16 int16_value") + "int8 more\n")
    options = (f"/{shared_peer.name}", str(tmp_path), "--json", "--timeout", "15")
    command = (sys.executable, "-m", "rosidl_py_gen.generator_cli", "diff", *options)
    pipe = asyncio.subprocess.PIPE
    process = await start_process(*command, env=without_definitions(tmp_path / "cache"), stdout=pipe, stderr=pipe)
    out, err = await asyncio.wait_for(process.communicate(), 80)
    assert process.returncode == 1, err
    differences = json.loads(out)
    (change,) = [type_ for type_ in differences["changed"] if type_["name"] == "test_msgs/msg/BasicTypes"]
    message = change["messages"][0]
    assert [(one["what"], one["name"]) for one in message["fields"]] == [("type", "int16_value"), ("added", "more")]
    assert message["old_data"]["reading"] == "fails" and message["constants"] == []
    assert differences["removed"] == []
