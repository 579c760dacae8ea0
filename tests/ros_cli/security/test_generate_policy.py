"""``rosidl-py security generate_policy`` beside nodes, compared with the policy that SROS2 made of them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import String
from std_srvs.srv import Trigger

from rosidl_py_gen.ros_cli.security.policy import read_policy
from rosidl_py_gen.runtime import Context
from rosidl_py_gen.runtime.transport.discovery_events import NodeEntities

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool
    from support.node_fixtures import World

QUIET: Any = {
    "start_services": False,
    "enable_rosout": False,
    "parameter_events": False,
    "parameter_overrides": {"start_type_description_service": False},
}


@pytest.fixture
def graph(memory: World, golden: Path) -> None:
    """The nodes of graph.json."""
    contexts: dict[str, Context] = {}
    for one in json.loads((golden / "graph.json").read_text()):
        enclave = one["enclave"]
        if enclave not in contexts:
            contexts[enclave] = memory.context(args=["--ros-args", "--enclave", enclave])
        node = memory.node(one["name"], one["namespace"], context=contexts[enclave], **QUIET)
        for name in one["publishers"]:
            node.create_publisher(String, name)
        for name in one["subscribers"]:
            node.create_subscription(String, name)
        for name in one["services"]:
            node.create_service(Trigger, name)
        for name in one["clients"]:
            node.create_client(Trigger, name)
