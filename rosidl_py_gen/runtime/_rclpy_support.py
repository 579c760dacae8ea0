"""Internal functions of the runtime that the rclpy layer (`rosidl_py_gen/ros_compat`) uses; not a public interface.

The layer may import public names and this module. It has its own classes for parameters, descriptors and profiles, so
the functions have plain values as parameters.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.actions.states import MIN_RESULT_RETENTION_NS as MIN_RESULT_RETENTION_NS
from rosidl_py_gen.runtime.names.validation import NameFault as NameFault
from rosidl_py_gen.runtime.names.validation import NameRule as NameRule
from rosidl_py_gen.runtime.names.validation import find_full_name_fault as find_full_name_fault
from rosidl_py_gen.runtime.names.validation import find_name_fault as find_name_fault
from rosidl_py_gen.runtime.names.validation import find_namespace_fault as find_namespace_fault
from rosidl_py_gen.runtime.names.validation import find_node_name_fault as find_node_name_fault
from rosidl_py_gen.runtime.parameters.validation import EMPTY_LIST_REASON as EMPTY_LIST_REASON
from rosidl_py_gen.runtime.parameters.validation import RELATIVE_TOLERANCE as RELATIVE_TOLERANCE
from rosidl_py_gen.runtime.parameters.validation import SEPARATOR as SEPARATOR
from rosidl_py_gen.runtime.parameters.validation import UNDECLARED_REASON as UNDECLARED_REASON
from rosidl_py_gen.runtime.parameters.validation import float_range_reason as float_range_reason
from rosidl_py_gen.runtime.parameters.validation import integer_range_reason as integer_range_reason
from rosidl_py_gen.runtime.parameters.validation import list_names as list_names
from rosidl_py_gen.runtime.parameters.validation import read_only_reason as read_only_reason
from rosidl_py_gen.runtime.parameters.validation import type_reason as type_reason

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.graph.graph import NamesAndTypes
    from rosidl_py_gen.runtime.node.node import Node


def wire_topics_of_node(node: Node, name: str, namespace: str, *, writers: bool) -> NamesAndTypes:
    """Return all topics that another node writes or reads, those of services too, as they are in the middleware."""
    return node._of_node(name, namespace, writers=writers, demangle=False)
