"""What generated code needs at run time: base classes, CDR support, lazy packages (standard library and numpy only).

Loaded piece by piece, so that importing a generated package costs next to nothing until a message is used.
"""

from typing import TYPE_CHECKING

from rosidl_py_gen.cdr.lazy import lazy_exports

if TYPE_CHECKING:
    from rosidl_py_gen.cdr.message import Action as Action
    from rosidl_py_gen.cdr.message import Field as Field
    from rosidl_py_gen.cdr.message import Message as Message
    from rosidl_py_gen.cdr.message import Service as Service
    from rosidl_py_gen.cdr.message import ServiceInfo as ServiceInfo
    from rosidl_py_gen.cdr.message import TypeInfo as TypeInfo
    from rosidl_py_gen.cdr.walk import recover_decode as recover_decode
    from rosidl_py_gen.cdr.walk import recover_encode as recover_encode
    from rosidl_py_gen.cdr.walk import validate as validate
else:
    __getattr__, __dir__ = lazy_exports(
        __name__,
        {
            **dict.fromkeys(("Action", "Field", "Message", "Service", "ServiceInfo", "TypeInfo"), "message"),
            **dict.fromkeys(("recover_decode", "recover_encode", "validate"), "walk"),
        },
    )

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
