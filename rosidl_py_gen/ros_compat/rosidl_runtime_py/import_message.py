"""Function that imports the message class for a type in `SLOT_TYPES`."""

import importlib
import warnings
from typing import Any

from rosidl_parser.definition import NamespacedType

_FEEDBACK = "_FeedbackMessage"


def import_message_from_namespaced_type(message_type: Any) -> Any:
    """Return the class for a `NamespacedType`; the class for ``X_FeedbackMessage`` is ``X.Impl.FeedbackMessage``.

    Raises:
        ImportError, AttributeError: the class does not exist.
    """
    if not isinstance(message_type, NamespacedType) and hasattr(message_type, "value_type"):
        message_type = message_type.value_type
        text = "Passing objects containing a NamespacedType is deprecated, please pass a NamespacedType object directly"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
    module = importlib.import_module(".".join(message_type.namespaces))
    name: str = message_type.name
    if name.endswith(_FEEDBACK):
        return getattr(module, name.removesuffix(_FEEDBACK)).Impl.FeedbackMessage
    return getattr(module, name)
