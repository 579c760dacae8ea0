"""Files of ``--qos-profile-overrides-path``."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.bag.qos_overrides import parse_qos_overrides, read_qos_overrides
from rosidl_py_gen.runtime import Durability, History, Liveliness, QoSProfile, Reliability
from rosidl_py_gen.runtime.qos import INFINITE_NS

ALL = """\
/scan:
  history: keep_last
  depth: 5
  reliability: best_effort
  durability: TRANSIENT_LOCAL
  deadline: {sec: 1, nsec: 500000000}
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: manual_by_topic
  liveliness_lease_duration:
  avoid_ros_namespace_conventions: false
/a/map: {history: keep_all}
"""


def test_policies_have_the_names_of_rosbag2(tmp_path: Path) -> None:
    path = tmp_path / "qos.yaml"
    path.write_text(ALL)
    assert read_qos_overrides(str(path)) == {
        "/scan": QoSProfile(
            History.KEEP_LAST,
            5,
            Reliability.BEST_EFFORT,
            Durability.TRANSIENT_LOCAL,
            1_500_000_000,
            INFINITE_NS,
            Liveliness.MANUAL_BY_TOPIC,
        ),
        "/a/map": QoSProfile(History.KEEP_ALL),
    }
    assert read_qos_overrides(None) == parse_qos_overrides("") == parse_qos_overrides("# nothing\n") == {}


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("scan: {depth: 1}", "<profiles>:1:1: expected the full name of a topic"),
        ("- /scan", "<profiles>:1:1: expected topics"),
        ("/scan: 5", "<profiles>:1:8: expected policies, of history"),
        (
            "/scan:\n  depht: 5",
            "<profiles>:2:3: expected policies, of history, reliability, durability, liveliness, depth",
        ),
        ("/scan:\n  depth: -1", '<profiles>:2:10: depth: expected a whole number, 0 or more; found "-1"'),
        ("/scan:\n  depth: 3000000000", "<profiles>:2:3: /scan: depth must be an int from 0"),
        ("/scan:\n  depth: [1]", "<profiles>:2:10: depth: expected a whole number, 0 or more"),
        ("/scan:\n  reliability: best", "<profiles>:2:16: reliability: expected one of system_default, reliable"),
        ("/scan:\n  durability: unknown", "<profiles>:2:15: durability: expected one of"),
        ("/scan:\n  deadline: {sec: 1}", "<profiles>:2:13: deadline: expected sec: and nsec:, found only sec:"),
        ("/scan:\n  deadline: {s: 1}", '<profiles>:2:14: deadline: expected sec: and nsec:, found "s"'),
        ("/scan:\n  deadline: 1", "<profiles>:2:13: deadline: expected sec: and nsec:"),
        ("/scan:\n  avoid_ros_namespace_conventions: 2", "<profiles>:2:36: avoid_ros_namespace_conventions: expected"),
        ("/scan: {}\n/scan: {}", '<profiles>:2:1: "/scan" is defined twice'),
        ("/scan: &a {depth: 1}\n/b: *a", "<profiles>:1:8: anchors and aliases are not supported"),
        ("/scan: {", "<profiles>:2:1: did not find expected node content"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(text: str, error: str) -> None:
    with pytest.raises(CommandError) as caught:
        parse_qos_overrides(text)
    assert str(caught.value).startswith(error)


@given(
    st.text()
    | st.recursive(
        st.none() | st.integers() | st.text(),
        lambda one: st.dictionaries(st.sampled_from(["/a", "depth", "history", "deadline", "sec", "nsec"]), one),
    ).map(yaml.safe_dump)
)
def test_any_text_is_profiles_or_an_error_of_ours(text: str) -> None:
    try:
        found = parse_qos_overrides(text)
    except CommandError:
        return
    assert all(isinstance(one, QoSProfile) for one in found.values())
