"""Topics, services and actions that recorded topics belong to."""

from __future__ import annotations

import re
from typing import NamedTuple

_EVENT = "/_service_event"
_ACTION = "/_action/"
_ACTION_TOPICS = "feedback", "status"
_ACTION_SERVICES = "send_goal", "cancel_goal", "get_result"
_EVENT_TYPE = re.compile(r"[^/]+/(srv|action)/[^/]+_Event\Z")
_ACTION_TYPE = re.compile(r"action_msgs/msg/GoalStatusArray\Z|.+_FeedbackMessage\Z")


class TopicOwner(NamedTuple):
    """Topic, service or action that a topic belongs to.

    Attributes:
        kind: ``topic``, ``service`` or ``action``.
        name: name of the topic, service or action.
        service: service whose events the topic has, also one of an action; empty for other topics.
    """

    kind: str
    name: str
    service: str = ""


def topic_owner(topic: str, type_name: str) -> TopicOwner:
    """Return the topic, service or action that a topic belongs to, by name and type; the name alone is ambiguous."""
    is_event = topic.endswith(_EVENT) and _EVENT_TYPE.match(type_name) is not None
    service = topic.removesuffix(_EVENT) if is_event else ""
    action, mark, part = (service or topic).rpartition(_ACTION)
    is_part = part in _ACTION_SERVICES if service else part in _ACTION_TOPICS and _ACTION_TYPE.match(type_name)
    if mark and action and is_part:
        return TopicOwner("action", action, service)
    return TopicOwner("service", service, service) if service else TopicOwner("topic", topic)
