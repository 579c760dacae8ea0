"""ROS 2 in Python from pip alone: typed message packages, CDR, type support.

Importing this package is cheap; what a name needs is loaded when the name is first used. The node runtime is
`rosidl_py_gen.runtime` and needs the extra ``node``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Action as Action
    from rosidl_py_gen.cdr import Message as Message
    from rosidl_py_gen.cdr import Service as Service
    from rosidl_py_gen.cdr import validate as validate
    from rosidl_py_gen.codec import decode as decode
    from rosidl_py_gen.codec import encode as encode
    from rosidl_py_gen.convert import from_dict as from_dict
    from rosidl_py_gen.convert import from_json as from_json
    from rosidl_py_gen.convert import to_dict as to_dict
    from rosidl_py_gen.convert import to_json as to_json
    from rosidl_py_gen.dynamic import compile_text as compile_text
    from rosidl_py_gen.dynamic import get_action as get_action
    from rosidl_py_gen.dynamic import get_message as get_message
    from rosidl_py_gen.dynamic import get_service as get_service
    from rosidl_py_gen.errors import ClosedError as ClosedError
    from rosidl_py_gen.errors import DecodeError as DecodeError
    from rosidl_py_gen.errors import DefinitionError as DefinitionError
    from rosidl_py_gen.errors import EncodeError as EncodeError
    from rosidl_py_gen.errors import InvalidNameError as InvalidNameError
    from rosidl_py_gen.errors import OutputError as OutputError
    from rosidl_py_gen.errors import RosidlError as RosidlError
    from rosidl_py_gen.errors import TypeNotFoundError as TypeNotFoundError
    from rosidl_py_gen.typesupport import type_description as type_description
    from rosidl_py_gen.typesupport import type_hash as type_hash
    from rosidl_py_gen.typesupport import type_name as type_name

_MODULES = {
    **dict.fromkeys(("Action", "Message", "Service", "validate"), "cdr"),
    **dict.fromkeys(("decode", "encode"), "codec"),
    **dict.fromkeys(("from_dict", "from_json", "to_dict", "to_json"), "convert"),
    **dict.fromkeys(("compile_text", "get_action", "get_message", "get_service"), "dynamic"),
    **dict.fromkeys(
        (
            "ClosedError",
            "DecodeError",
            "DefinitionError",
            "EncodeError",
            "InvalidNameError",
            "OutputError",
            "RosidlError",
            "TypeNotFoundError",
        ),
        "errors",
    ),
    **dict.fromkeys(("type_description", "type_hash", "type_name"), "typesupport"),
}
__all__ = sorted(_MODULES)

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        from importlib import import_module

        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *_MODULES})
