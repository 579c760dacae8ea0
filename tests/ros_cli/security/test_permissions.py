"""Permissions made from policies, compared with those that SROS2 made from them, and ``generate_artifacts``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.ros_cli.security.policy import expand_name

if TYPE_CHECKING:
    from collections.abc import Callable

    Run = Callable[..., str]

pytestmark = pytest.mark.needs("cryptography")
ENCLAVES = "/fleet/camera", "/fleet/planner", "/two_grants", "/idle", "/"
TIME = re.compile(r"<(not_before|not_after)>.+?<")


def without_times(path: Path) -> str:
    return TIME.sub(r"<\1><", path.read_text())


@pytest.mark.parametrize("name", ENCLAVES)
def test_permissions_are_those_of_sros2(keystore: Path, golden: Path, succeed: Run, name: str) -> None:
    succeed("create_enclave", str(keystore), name)
    succeed("create_permission", str(keystore), name, str(golden / "policies/fleet.xml"))
    recorded = golden / "permissions" / f"{name[1:].replace('/', '.') or 'root'}.xml"
    assert without_times(keystore / f"enclaves{name}/permissions.xml") == without_times(recorded)


def test_generate_artifacts_makes_everything(tmp_path: Path, golden: Path, monkeypatch: Any, run_here: Any) -> None:
    root = tmp_path / "deep/keystore"
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(root))
    words = ["-e", "/extra", "/idle", "-p", str(golden / "policies/fleet.xml")]
    code, out, err = run_here("security", "generate_artifacts", *words)
    assert (code, err) == (0, f"created keystore {root} for domain 0\n")
    assert out.split() == ["/extra", "/idle", "/fleet/camera", "/fleet/planner", "/two_grants", "/"]
    for name in ENCLAVES:
        recorded = golden / "permissions" / f"{name[1:].replace('/', '.') or 'root'}.xml"
        assert without_times(root / f"enclaves{name}/permissions.xml") == without_times(recorded)
    assert "<topic>rt/*</topic>" in (root / "enclaves/extra/permissions.xml").read_text()
    key = (root / "enclaves/idle/key.pem").read_bytes()
    assert run_here("security", "generate_artifacts", *words)[::2] == (0, "")
    assert (root / "enclaves/idle/key.pem").read_bytes() == key


def test_nothing_is_written_before_all_policies_are_valid(tmp_path: Path, golden: Path, fail: Run) -> None:
    root, wrong = tmp_path / "keystore", tmp_path / "wrong.xml"
    wrong.write_text("<policy version='0.2.0'><enclaves/></policy>")
    fleet = str(golden / "policies/fleet.xml")
    error = fail("generate_artifacts", "-k", str(root), "-p", fleet, str(wrong))
    assert "wrong.xml:1:25: <enclaves> is empty; expected at least one <enclave>" in error
    assert not root.exists()
    error = fail("generate_artifacts", "-k", str(root), "-p", fleet, str(golden / "policies/two_grants.xml"))
    assert "enclave /two_grants is in " in error and "expected it in one policy" in error
    assert "invalid enclave name '/a b'" in fail("generate_artifacts", "-k", str(root), "-e", "/ok", "/a b")
    assert not root.exists()
    assert "no keystore: ROS_SECURITY_KEYSTORE is not set; expected -k ROOT" in fail("generate_artifacts", "-e", "/a")


def test_permissions_need_an_enclave(keystore: Path, golden: Path, succeed: Run, fail: Run, tmp_path: Path) -> None:
    policy = str(golden / "policies/fleet.xml")
    error = fail("create_permission", str(keystore), "/idle", policy)
    assert (
        f"enclave /idle has no certificate; create it with `rosidl-py security create_enclave {keystore} /idle`"
        in error
    )
    succeed("create_enclave", str(keystore), "/idel")
    assert 'has no enclave /idel; did you mean "/idle"?' in fail("create_permission", str(keystore), "/idel", policy)
    missing = fail("create_permission", str(keystore), "/idle", str(tmp_path / "none.xml"))
    assert "none.xml: cannot be read: No such file or directory" in missing


def test_completion_offers_the_enclaves_of_the_keystore(keystore: Path, succeed: Run) -> None:
    import click

    from rosidl_py_gen.ros_cli.security.commands import create_permission

    succeed("create_enclave", str(keystore), "/robot/arm")
    context = click.Context(create_permission)
    context.params["root"] = keystore
    name = next(one for one in create_permission.params if one.name == "name")
    assert [item.value for item in name.shell_complete(context, "/r")] == ["/robot/arm"]
    assert name.shell_complete(context, "/x") == []
    context.params.clear()
    assert name.shell_complete(context, "") == []


@pytest.mark.parametrize(
    ("expression", "namespace", "expected"),
    [
        ("chatter", "/", "/chatter"),
        ("chatter", "/a/b", "/a/b/chatter"),
        ("chatter", "/a/", "/a/chatter"),
        ("/chatter", "/a", "/chatter"),
        ("~", "/a", "/a/node"),
        ("~/x", "/a", "/a/node/x"),
        ("~/x", "/", "/node/x"),
        ("*", "/a", "/a/*"),
    ],
)
def test_names_are_expanded_as_in_programs(expression: str, namespace: str, expected: str) -> None:
    assert expand_name(expression, namespace, "node") == expected


NAMES = st.sampled_from(["a", "b", "/c", "~/d", "*", "/*"])
BLOCKS = st.lists(
    st.tuples(
        st.sampled_from(
            [("topics", "publish", "subscribe"), ("services", "request", "reply"), ("actions", "call", "execute")]
        ),
        st.sampled_from([None, "ALLOW", "DENY"]),
        st.sampled_from(["ALLOW", "DENY"]),
        st.lists(NAMES, min_size=1, max_size=4),
    ),
    max_size=6,
)


@given(BLOCKS)
def test_denials_are_complete_and_come_first(blocks: list[Any]) -> None:
    """Independent of the program's own order: what a block denies is in the deny rule, for the right direction."""
    from datetime import datetime
    from xml.etree import ElementTree

    from rosidl_py_gen.base.xml_reader import XmlElement
    from rosidl_py_gen.ros_cli.security.permissions import permissions_xml
    from rosidl_py_gen.ros_cli.security.policy import PolicyEnclave, PolicyRule

    rules = []
    expected: dict[tuple[str, str], set[str]] = {}
    for (kind, first, second), one, other, names in blocks:
        access = {first: one, second: other} if one else {second: other}
        full = tuple(expand_name(name, "/ns", "node") for name in names)
        rules.append(PolicyRule(kind, access, full))
        for name in full:
            for attribute, qualifier in access.items():
                for direction, topic in directions(attribute, name):
                    expected.setdefault((qualifier, direction), set()).add(topic)
    enclave = PolicyEnclave("/e", (tuple(rules),), XmlElement("enclave"))
    text = permissions_xml(enclave, 7, datetime(2020, 1, 1), datetime(2030, 1, 1))
    found: dict[tuple[str, str], set[str]] = {}
    tags = []
    for rule in ElementTree.fromstring(text).iterfind("permissions/grant/*"):
        tags.append(rule.tag)
        for direction in ("publish", "subscribe"):
            topics = [str(topic.text) for topic in rule.iterfind(f"{direction}/topics/topic")]
            assert len(set(topics)) == len(topics)
            if topics not in ([], ["ros_discovery_info"]):
                found[{"deny_rule": "DENY", "allow_rule": "ALLOW"}[rule.tag], direction] = set(topics)
    assert found == expected
    rules_in_order = [tag for tag in tags if tag.endswith("_rule")]
    assert rules_in_order == sorted(rules_in_order, reverse=True) and rules_in_order[-1] == "allow_rule"
    assert tags[-1] == "default"


def directions(attribute: str, name: str) -> list[tuple[str, str]]:
    """Direction and DDS topic for each topic of a name, written as a table."""
    services = [f"{name}/_action/{part}" for part in ("send_goal", "cancel_goal", "get_result")]
    feedback = [f"rt{name}/_action/{part}" for part in ("feedback", "status")]
    match attribute:
        case "publish" | "subscribe":
            return [(attribute, f"rt{name}")]
        case "request":
            return [("publish", f"rq{name}Request"), ("subscribe", f"rr{name}Reply")]
        case "reply":
            return [("subscribe", f"rq{name}Request"), ("publish", f"rr{name}Reply")]
        case "call":
            return [pair for one in services for pair in directions("request", one)] + [
                ("subscribe", one) for one in feedback
            ]
        case _:
            return [pair for one in services for pair in directions("reply", one)] + [
                ("publish", one) for one in feedback
            ]
