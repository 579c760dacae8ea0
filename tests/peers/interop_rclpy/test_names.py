"""Names are refused exactly if rclpy refuses them, at the same index."""

from __future__ import annotations

import itertools
import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from rosidl_py_gen.runtime import (
    InvalidNameError,
    validate_full_name,
    validate_name,
    validate_namespace,
    validate_node_name,
)

PROGRAM = """
import json, sys
from rclpy.impl.implementation_singleton import rclpy_implementation as rclpy

names = json.load(sys.stdin)
checks = [getattr(rclpy, "rclpy_get_validation_error_for_" + kind) for kind in sys.argv[1:]]
json.dump([[(check(name) or (None, None))[1] for name in names] for check in checks], sys.stdout)
"""
CHECKS = {
    "topic_name": validate_name,
    "full_topic_name": validate_full_name,
    "node_name": validate_node_name,
    "namespace": validate_namespace,
}
NAMES = ["".join(parts) for size in range(5) for parts in itertools.product("a_/~{}1-", repeat=size)]
NAMES += [start + "a" * size for start in ("", "/", "/a/") for size in range(240, 260)]


@pytest.mark.real_time("another process answers")
def test_names_are_refused_at_same_index_as_rclpy(peer_python: Path) -> None:
    command = [str(peer_python), "-c", PROGRAM, *CHECKS]
    answer = subprocess.run(command, input=json.dumps(NAMES), capture_output=True, text=True, check=True, timeout=60)
    for (kind, check), rclpy_indexes in zip(CHECKS.items(), json.loads(answer.stdout), strict=True):
        both = {name: (place(check, name), index) for name, index in zip(NAMES, rclpy_indexes, strict=True)}
        differ = {name: places for name, places in both.items() if places[0] != places[1]}
        if kind == "topic_name":  # rcl refuses these when it expands them
            later = {name for name in differ if "{}" in name or (name[0] == "~" and len(name) == 2)}
            assert later and {differ.pop(name)[1] for name in later} == {None}
        assert differ == {}, kind


def place(check: Callable[[str], None], name: str) -> int | None:
    try:
        check(name)
    except InvalidNameError as error:
        assert error.name == name and error.reason in str(error)
        return error.index
    return None
