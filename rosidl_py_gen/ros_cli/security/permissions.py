"""Governance and permissions of DDS Security as XML, for all implementations of ROS 2 on DDS.

Permissions name DDS topics: ``rt/NAME`` is a topic; ``rq/NAMERequest`` and ``rr/NAMEReply`` are the topics of a
service; an action has two topics and three services.

Source: DDS Security 1.1, 9.4.1; docs/internals/protocol.md 4, 6.2, 8.1; docs/internals/keystores.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.xml_reader import XmlElement
from rosidl_py_gen.ros_cli.security.policy import ALLOW, DENY, xml_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime

    from rosidl_py_gen.ros_cli.security.policy import PolicyEnclave, PolicyRule

_SCHEMA = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_{}.xsd"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
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
"""DDS topic on which every participant of ROS announces its nodes."""
_ACTION_SERVICES = "cancel_goal", "get_result", "send_goal"
_ACTION_TOPICS = "feedback", "status"


def governance_xml(domain_id: int) -> str:
    """Return the governance of a keystore as XML: participants are authenticated, and everything is encrypted."""
    topic_rules = _element("topic_access_rules", _element("topic_rule", *_texts(_TOPIC_RULES)))
    rule = _element("domain_rule", _domains(domain_id), *_texts(_DOMAIN_RULES), topic_rules)
    return _document("governance", _element("domain_access_rules", rule))


def permissions_xml(enclave: PolicyEnclave, domain_id: int, not_before: datetime, not_after: datetime) -> str:
    """Return the permissions of an enclave as XML, with denials first, because the first rule that names a topic
    decides.

    The permissions are valid as long as the certificate of the enclave: from `not_before` to `not_after`, in UTC.
    """
    times = {"not_before": not_before, "not_after": not_after}
    grants = []
    for rules in enclave.grants:
        grant = _element(
            "grant",
            *_texts({"subject_name": f"CN={enclave.name}"}),
            _element("validity", *_texts({name: f"{time:%Y-%m-%dT%H:%M:%S}" for name, time in times.items()})),
            *_rule("deny_rule", domain_id, *_topics(rules, DENY)),
            *_rule("allow_rule", domain_id, *_topics(rules, ALLOW)),
            *_rule("allow_rule", domain_id, [_GRAPH_TOPIC], [_GRAPH_TOPIC]),
            *_texts({"default": "DENY"}),
        )
        grant.attributes["name"] = enclave.name
        grants.append(grant)
    return _document("permissions", _element("permissions", *grants))


def _document(schema: str, content: XmlElement) -> str:
    names = {"xmlns:xsi": _XSI, "xsi:noNamespaceSchemaLocation": _SCHEMA.format(schema)}
    return xml_text(XmlElement("dds", names, children=[content]))


def _element(tag: str, *children: XmlElement) -> XmlElement:
    return XmlElement(tag, children=[*children])


def _texts(values: Mapping[str, str]) -> list[XmlElement]:
    return [XmlElement(tag, text=text) for tag, text in values.items()]


def _domains(domain_id: int) -> XmlElement:
    return _element("domains", *_texts({"id": str(domain_id)}))


def _rule(tag: str, domain_id: int, published: list[str], subscribed: list[str]) -> list[XmlElement]:
    topics = {"publish": published, "subscribe": subscribed}
    directions = [
        _element(direction, _element("topics", *(XmlElement("topic", text=name) for name in names)))
        for direction, names in topics.items()
        if names
    ]
    return [_element(tag, _domains(domain_id), *directions)] if directions else []


def _topics(rules: Sequence[PolicyRule], qualifier: str) -> tuple[list[str], list[str]]:
    """Return the DDS topics to publish on, and the DDS topics to subscribe to, that rules allow or deny
    (`qualifier`).
    """
    published: list[list[str]] = []
    subscribed: list[list[str]] = []
    for rule in rules:
        for attribute in (name for name, value in rule.access.items() if value == qualifier):
            sent, received = _directions(rule, attribute)
            published += [sent] if sent else []
            subscribed += [received] if received else []
    return _merged(published), _merged(subscribed)


def _merged(groups: list[list[str]]) -> list[str]:
    """Return the topics of several groups without repetition; groups are sorted by their first topics, as in SROS2."""
    return [*dict.fromkeys(topic for group in sorted(groups, key=lambda one: one[0]) for topic in group)]


def _directions(rule: PolicyRule, attribute: str) -> tuple[list[str], list[str]]:
    """Return the DDS topics to publish on, and the DDS topics to subscribe to, for one attribute of a policy rule."""
    if rule.kind == "topics":
        topics = [f"rt{name}" for name in rule.names]
        return (topics, []) if attribute == "publish" else ([], topics)
    requests: list[str] = []
    replies: list[str] = []
    for name in rule.names:
        is_action = rule.kind == "actions"
        services = [f"{name}/_action/{one}" for one in _ACTION_SERVICES] if is_action else [name]
        requests += (f"rq{service}Request" for service in services)
        replies += (f"rr{service}Reply" for service in services)
        replies += (f"rt{name}/_action/{topic}" for topic in _ACTION_TOPICS if is_action)
    return (requests, replies) if attribute in ("request", "call") else (replies, requests)
