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

__version__: str
