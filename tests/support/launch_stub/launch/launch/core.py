"""Actions, substitutions and contexts."""

from __future__ import annotations

import types
from collections.abc import Callable
from contextlib import suppress
from typing import Any


class SubstitutionFailure(RuntimeError):
    pass


class LaunchConfiguration:
    def __init__(self, name: str) -> None:
        self._name = name

    def perform(self, context: Context) -> str:
        if self._name not in context.launch_configurations:
            raise SubstitutionFailure(f"launch configuration '{self._name}' does not exist")
        return context.launch_configurations[self._name]


class Context:
    def __init__(self, service: Any) -> None:
        self.service = service
        self.launch_configurations: dict[str, str] = {}
        self.locals = types.SimpleNamespace()
        self.on_shutdown: list[Callable[[], None]] = []


class LaunchDescriptionEntity:
    def describe_sub_entities(self) -> list[Any]:
        return []

    def describe_conditional_sub_entities(self) -> list[tuple[str, list[Any]]]:
        return []


class Action(LaunchDescriptionEntity):
    def __init__(self, condition: Callable[[Context], bool] | None = None) -> None:
        self._condition = condition

    def visit(self, context: Context) -> list[Any] | None:
        if self._condition is None or self._condition(context):
            return self.execute(context)
        return None

    def execute(self, context: Context) -> list[Any] | None:
        return None


class LaunchDescription(LaunchDescriptionEntity):
    def __init__(self, entities: list[Any]) -> None:
        self.entities = list(entities)

    def describe_sub_entities(self) -> list[Any]:
        return self.entities

    def visit(self, context: Context) -> list[Any]:
        return self.entities

    def get_launch_arguments(self) -> list[Any]:
        return [one for one, _ in self.get_launch_arguments_with_include_launch_description_actions()]

    def get_launch_arguments_with_include_launch_description_actions(self) -> list[tuple[Any, Any]]:
        found: list[tuple[Any, Any]] = []

        def process_entities(entities: list[Any], include: Any) -> None:
            for one in entities:
                if hasattr(one, "default_value"):
                    found.append((one, include))
                elif isinstance(getattr(one, "launch_description_source", None), LaunchDescriptionSource):
                    with suppress(OSError):
                        process_entities(one.launch_description_source.get_launch_description(None).entities, one)

        process_entities(self.entities, None)
        return found


class LaunchDescriptionSource:
    def __init__(self, description: LaunchDescription, location: str, method: str) -> None:
        self._description, self.location = description, location

    def get_launch_description(self, context: Context) -> LaunchDescription:
        return self._description
