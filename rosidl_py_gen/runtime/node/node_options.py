"""Options of a node: the keyword arguments of `Node`, as its mixins get them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rosidl_py_gen.runtime.node.arguments import RosArguments


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeOptions:
    """Keyword arguments of `Node`; `arguments` are its parsed ``cli_args``."""

    arguments: RosArguments
    use_global_arguments: bool
    enable_rosout: bool
    parameter_overrides: Mapping[str, object] | None
    allow_undeclared_parameters: bool
    automatically_declare_parameters_from_overrides: bool
    start_services: bool
    parameter_events: bool
    logger_services: bool
    time_source: bool
