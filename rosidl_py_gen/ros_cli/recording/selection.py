"""Which topics ``bag record`` takes.

Decides whose a topic is, a service's, an action's or its own, and that what is excluded is left out whatever includes
it. Source: rosbag2's design documents of recording services and actions, and its topic filter.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.ros_cli import ToolError
from rosidl_py_gen.ros_cli.name_lookup import TopicOwner, is_hidden, topic_owner
from rosidl_py_gen.runtime import validate_full_name

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.ros_cli.recording.command import RecordOptions


def owner_of(topic: str, type_name: str) -> TopicOwner:
    """The topic itself, the service or the action, whichever of its services the topic is of."""
    kind, name, _ = topic_owner(topic, type_name)
    return TopicOwner(kind, name)


class Selection:
    """What was asked for; raises `ToolError` and `InvalidNameError` for patterns and names that are none."""

    def __init__(self, options: RecordOptions) -> None:
        self.named = [
            *(TopicOwner("topic", name) for name in _full(options.topics)),
            *(TopicOwner("service", name) for name in _full(options.services)),
            *(TopicOwner("action", name) for name in _full(options.actions)),
        ]
        """What was named, hidden or not."""
        self._left_out = {
            "topic": {*_full(options.exclude_topics)},
            "service": {*_full(options.exclude_services)},
            "action": {*_full(options.exclude_actions)},
        }
        self._all = {
            "topic": options.everything or options.all_topics,
            "service": options.everything or options.all_services,
            "action": options.everything or options.all_actions,
        }
        self._types = {str(split_ros_name(name, "msg")) for name in options.topic_types}
        self._excluded_types = {str(split_ros_name(name, "msg")) for name in options.exclude_topic_types}
        self._regex = None if options.regex is None else _pattern(options.regex)
        self._exclude = [_pattern(text) for text in options.exclude]
        self._hidden = options.hidden

    def takes(self, topic: str, type_name: str) -> bool:
        """Whether a topic is recorded."""
        if TopicOwner("topic", topic) in self.named:  # whoever's it is
            return not self._is_left_out(TopicOwner("topic", topic), type_name)
        whose = owner_of(topic, type_name)
        if self._is_left_out(whose, type_name):
            return False
        is_wanted = (
            self._all[whose.kind]
            or whose in self.named
            or (self._regex is not None and self._regex.search(whose.name) is not None)
        )
        if whose.kind != "topic":
            return is_wanted
        return (is_wanted or type_name in self._types) and (self._hidden or not is_hidden(topic))

    def _is_left_out(self, whose: TopicOwner, type_name: str) -> bool:
        return (
            whose.name in self._left_out[whose.kind]
            or any(one.search(whose.name) for one in self._exclude)
            or (whose.kind == "topic" and type_name in self._excluded_types)
        )


def _full(names: Iterable[str]) -> list[str]:
    found = [name if name.startswith("/") else f"/{name}" for name in names]
    for name in found:
        validate_full_name(name)
    return found


def _pattern(text: str) -> re.Pattern[str]:
    try:
        return re.compile(text)
    except re.error as error:
        raise ToolError(f'"{text}" is no regular expression: {error}') from None
