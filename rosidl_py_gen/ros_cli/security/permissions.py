"""Governance and permissions of DDS Security as XML, for all implementations of ROS 2 on DDS.

Permissions name DDS topics: ``rt/NAME`` is a topic, ``rq/NAMERequest`` and ``rr/NAMEReply`` are those of a service, and
an action has two topics and three services. Source: DDS Security 1.1, 9.4.1; docs/internals/protocol.md 4, 6.2, 8.1;
docs/internals/keystores.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.xml_reader import escape
from rosidl_py_gen.ros_cli.security.policy import ALLOW, DENY

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from datetime import datetime

    from rosidl_py_gen.ros_cli.security.policy import PolicyEnclave, PolicyRule

_SCHEMA = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_{}.xsd"
_ROOT = '<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="{}">'
_DOMAIN_RULES = {
    "allow_unauthenticated_participants": "false",
    "enable_join_access_control": "true",
    "discovery_protection_kind": "ENCRYPT",
    "liveliness_protection_kind": "ENCRYPT",
    "rtps_protection_kind": "SIGN",
}
_TOPIC_RULES = {
    "topic_expression": "*",
    "enable_discovery_protection": "true",
    "enable_liveliness_protection": "true",
    "enable_read_access_control": "true",
    "enable_write_access_control": "true",
    "metadata_protection_kind": "ENCRYPT",
    "data_protection_kind": "ENCRYPT",
}
_GRAPH_TOPIC = "ros_discovery_info"
"""Topic on which every participant announces its nodes."""
_ACTION_SERVICES = "cancel_goal", "get_result", "send_goal"
_ACTION_TOPICS = "feedback", "status"


def governance_xml(domain_id: int) -> str:
    """Return the governance of a keystore: all participants are authenticated, and everything is encrypted."""
    lines = [
        _ROOT.format(_SCHEMA.format("governance")),
        "  <domain_access_rules>",
        "    <domain_rule>",
        *_indented(_domains(domain_id), 6),
        *(f"      <{name}>{value}</{name}>" for name, value in _DOMAIN_RULES.items()),
        "      <topic_access_rules>",
        "        <topic_rule>",
        *(f"          <{name}>{value}</{name}>" for name, value in _TOPIC_RULES.items()),
        "        </topic_rule>",
        "      </topic_access_rules>",
        "    </domain_rule>",
        "  </domain_access_rules>",
        "</dds>",
    ]
    return "\n".join(lines) + "\n"


def permissions_xml(enclave: PolicyEnclave, domain_id: int, not_before: datetime, not_after: datetime) -> str:
    """Return the permissions of an enclave; the first rule that names a topic decides, and denials are first.

    The validity is that of the certificate, in UTC.
    """
    lines = [_ROOT.format(_SCHEMA.format("permissions")), "  <permissions>"]
    for rules in enclave.grants:
        name = escape(enclave.name, is_attribute=True)
        lines += [
            f'    <grant name="{name}">',
            f"      <subject_name>CN={escape(enclave.name)}</subject_name>",
            "      <validity>",
            f"        <not_before>{_time(not_before)}</not_before>",
            f"        <not_after>{_time(not_after)}</not_after>",
            "      </validity>",
            *_indented(_rule("deny_rule", domain_id, *_topics(rules, DENY)), 6),
            *_indented(_rule("allow_rule", domain_id, *_topics(rules, ALLOW)), 6),
            *_indented(_rule("allow_rule", domain_id, [_GRAPH_TOPIC], [_GRAPH_TOPIC]), 6),
            "      <default>DENY</default>",
            "    </grant>",
        ]
    return "\n".join((*lines, "  </permissions>", "</dds>")) + "\n"


def _time(time: datetime) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S")


def _indented(lines: Iterable[str], width: int) -> Iterable[str]:
    return (" " * width + line for line in lines)


def _domains(domain_id: int) -> list[str]:
    return ["<domains>", f"  <id>{domain_id}</id>", "</domains>"]


def _rule(tag: str, domain_id: int, published: list[str], subscribed: list[str]) -> list[str]:
    if not published and not subscribed:
        return []
    lines = [f"<{tag}>", *_indented(_domains(domain_id), 2)]
    for direction, topics in (("publish", published), ("subscribe", subscribed)):
        if topics:
            lines += [f"  <{direction}>", "    <topics>"]
            lines += (f"      <topic>{escape(topic)}</topic>" for topic in topics)
            lines += ["    </topics>", f"  </{direction}>"]
    return [*lines, f"</{tag}>"]


def _topics(rules: Sequence[PolicyRule], qualifier: str) -> tuple[list[str], list[str]]:
    """Return the DDS topics to publish and to subscribe that the rules allow or deny, as `qualifier` says."""
    published: list[list[str]] = []
    subscribed: list[list[str]] = []
    for rule in rules:
        for attribute in (name for name, value in rule.access.items() if value == qualifier):
            sent, received = _directions(rule, attribute)
            published += [sent] if sent else []
            subscribed += [received] if received else []
    return _merged(published), _merged(subscribed)


def _merged(groups: list[list[str]]) -> list[str]:
    """Return the topics of groups without repetition; groups are sorted by their first topics, as in SROS2."""
    return [*dict.fromkeys(topic for group in sorted(groups, key=lambda one: one[0]) for topic in group)]


def _directions(rule: PolicyRule, attribute: str) -> tuple[list[str], list[str]]:
    """Return the DDS topics that an attribute of a rule is about: those to publish, and those to subscribe."""
    names = rule.names
    if rule.kind == "topics":
        topics = [f"rt{name}" for name in names]
        return (topics, []) if attribute == "publish" else ([], topics)
    if rule.kind == "services":
        requests = [f"rq{name}Request" for name in names]
        replies = [f"rr{name}Reply" for name in names]
        return (requests, replies) if attribute == "request" else (replies, requests)
    requests = [f"rq{name}/_action/{service}Request" for name in names for service in _ACTION_SERVICES]
    replies = [
        topic
        for name in names
        for topic in (
            *(f"rr{name}/_action/{service}Reply" for service in _ACTION_SERVICES),
            *(f"rt{name}/_action/{topic}" for topic in _ACTION_TOPICS),
        )
    ]
    return (requests, replies) if attribute == "call" else (replies, requests)
