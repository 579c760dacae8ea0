"""Messages as text and back, and which interfaces there are."""

from rosidl_runtime_py.convert import get_message_slot_types as get_message_slot_types
from rosidl_runtime_py.convert import message_to_csv as message_to_csv
from rosidl_runtime_py.convert import message_to_ordereddict as message_to_ordereddict
from rosidl_runtime_py.convert import message_to_yaml as message_to_yaml
from rosidl_runtime_py.get_interfaces import get_action_interfaces as get_action_interfaces
from rosidl_runtime_py.get_interfaces import get_interface_packages as get_interface_packages
from rosidl_runtime_py.get_interfaces import get_interface_path as get_interface_path
from rosidl_runtime_py.get_interfaces import get_interfaces as get_interfaces
from rosidl_runtime_py.get_interfaces import get_message_interfaces as get_message_interfaces
from rosidl_runtime_py.get_interfaces import get_service_interfaces as get_service_interfaces
from rosidl_runtime_py.import_message import (
    import_message_from_namespaced_type as import_message_from_namespaced_type,
)
from rosidl_runtime_py.set_message import set_message_fields as set_message_fields

__all__ = [
    "get_action_interfaces",
    "get_interface_packages",
    "get_interface_path",
    "get_interfaces",
    "get_message_interfaces",
    "get_message_slot_types",
    "get_service_interfaces",
    "import_message_from_namespaced_type",
    "message_to_csv",
    "message_to_ordereddict",
    "message_to_yaml",
    "set_message_fields",
]
