"""Selection of topics for ``bag record``.

A topic belongs to a service, an action or itself. Exclusion precedes inclusion. Source: rosbag2's design documents of
recording services and actions, and its topic filter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.ros_cli.name_lookup import TopicOwner, is_hidden, topic_owner
from rosidl_py_gen.ros_cli.options import compile_pattern
from rosidl_py_gen.runtime import validate_full_name

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.ros_cli.recording.command import RecordOptions


def owner_of(topic: str, type_name: str) -> TopicOwner:
    """Return the owner of a topic: the service or action that it belongs to, or else the topic itself."""
    kind, name, _ = topic_owner(topic, type_name)
    return TopicOwner(kind, name)


class Selection:
    """Topics that the options of ``bag record`` select.

    Raises `CommandError` for invalid patterns, `InvalidNameError` for invalid names.
    """

    def __init__(self, options: RecordOptions) -> None:
        topics = [*options.topics, *options.more_topics]
        included = {"topic": topics, "service": options.services, "action": options.actions}
        self.named = [TopicOwner(kind, name) for kind, names in included.items() for name in _full_names(names)]
        """Topics, services and actions that the user has named, hidden or not."""
        self._excluded = {
            "topic": {*_full_names(options.exclude_topics)},
            "service": {*_full_names(options.exclude_services)},
            "action": {*_full_names(options.exclude_actions)},
        }
        self._all = {
            "topic": options.everything or options.all_topics,
            "service": options.everything or options.all_services,
            "action": options.everything or options.all_actions,
        }
        self._types = {str(split_ros_name(name, "msg")) for name in options.topic_types}
        self._excluded_types = {str(split_ros_name(name, "msg")) for name in options.exclude_topic_types}
        self._regex = None if options.regex is None else compile_pattern(options.regex, "--regex")
        self._exclude_patterns = [compile_pattern(text, "--exclude") for text in options.exclude]
        self._hidden = options.hidden

    def takes(self, topic: str, type_name: str) -> bool:
        """Return True if the options select a topic, so that it is recorded."""
        if TopicOwner("topic", topic) in self.named:  # also if it belongs to a service or action
            return not self._is_excluded(TopicOwner("topic", topic), type_name)
        owner = owner_of(topic, type_name)
        if self._is_excluded(owner, type_name):
            return False
        is_wanted = (
            self._all[owner.kind]
            or owner in self.named
            or (self._regex is not None and self._regex.search(owner.name) is not None)
        )
        if owner.kind != "topic":
            return is_wanted
        return (is_wanted or type_name in self._types) and (self._hidden or not is_hidden(topic))

    def _is_excluded(self, owner: TopicOwner, type_name: str) -> bool:
        return (
            owner.name in self._excluded[owner.kind]
            or any(one.search(owner.name) for one in self._exclude_patterns)
            or (owner.kind == "topic" and type_name in self._excluded_types)
        )


def _full_names(names: Iterable[str]) -> list[str]:
    full_names = [name if name.startswith("/") else f"/{name}" for name in names]
    for name in full_names:
        validate_full_name(name)
    return full_names
