"""What generated code needs at run time: base classes, CDR support, lazy packages (standard library and numpy only)."""

from rosidl_py_gen.cdr.lazy import lazy_exports
from rosidl_py_gen.cdr.message import Action, Field, Message, Service, ServiceInfo, TypeInfo
from rosidl_py_gen.cdr.walk import recover_decode, recover_encode, validate

__all__ = [
    "Action",
    "Field",
    "Message",
    "Service",
    "ServiceInfo",
    "TypeInfo",
    "lazy_exports",
    "recover_decode",
    "recover_encode",
    "validate",
]
