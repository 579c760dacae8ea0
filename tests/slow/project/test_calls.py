"""Calls of Python that a service call and a goal take: `tools/calls.py` counts them, speed depends on them."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from support.folders import ROOT
from support.local_network import domain_id

LIMITS = {"service": 66, "goal": 300, "goal after a change": 300}
"""Counts that must not be exceeded: those of the change that lowered them (63, 287, 287), and some that vary."""


@pytest.mark.real_time("a process counts, for some seconds")
def test_service_call_and_goal_take_no_more_calls_than_recorded() -> None:
    command = [sys.executable, str(ROOT / "tools" / "calls.py"), *LIMITS, "--domain-id", str(domain_id())]
    output = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True, timeout=120).stdout
    counts = {name.strip(): int(count) for name, count in re.findall(r"^(\S.*?) +(\d+) calls in", output, re.M)}
    assert counts.keys() == LIMITS.keys()
    assert {name: count for name, count in counts.items() if count > LIMITS[name]} == {}
