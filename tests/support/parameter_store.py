"""A parameter store without a node, with all that it reports."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.parameters.store import ParameterStore
from rosidl_py_gen.runtime.parameters.values import Parameter, parameter_value

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import ParameterDescriptor, ParameterEvent, SetResult


def p(name: str, value: object = None) -> Parameter:
    return Parameter(name, parameter_value(value))


class StoreWorld:
    """`overrides` and values to set may have names with two underscores for each dot."""

    def __init__(self, *, allow_undeclared: bool = False, **overrides: object) -> None:
        self.events: list[ParameterEvent] = []
        self.heard: list[str] = []
        """Names of the parameters that the post-set callbacks were called with."""
        self.failures: list[tuple[str, type[BaseException] | None]] = []
        self.store = ParameterStore(
            {name.replace("__", "."): parameter_value(value) for name, value in overrides.items()},
            allow_undeclared=allow_undeclared,
            on_event=self.events.append,
            on_failure=lambda what: self.failures.append((what, sys.exc_info()[0])),
        )
        self.store.callbacks.add("post-set", lambda ps: self.heard.extend(item.name for item in ps))

    def declare(self, name: str, default: object = None, descriptor: ParameterDescriptor | None = None) -> object:
        return self.store.declare(name, parameter_value(default), descriptor).value

    def set(self, *parameters: Parameter, **values: object) -> SetResult:
        named = [p(name.replace("__", "."), value) for name, value in values.items()]
        return self.store.set_atomically([*parameters, *named])

    def get(self, name: str) -> object:
        return self.store.get(name).value

    def values(self) -> dict[str, object]:
        return {name: value.value for name, value in self.store.values().items()}

    def forget_reports(self) -> None:
        self.events.clear()
        self.heard.clear()
