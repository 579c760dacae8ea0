"""Names of enclaves, and the domain of permissions."""

from __future__ import annotations

import os

from rosidl_py_gen.errors import InvalidNameError

_MAX_COMMON_NAME = 64
"""Maximum characters of the common name in a certificate (ub-common-name, RFC 5280)."""


def check_enclave_name(name: str) -> None:
    """Raise `InvalidNameError` unless the name is one of rcl, such as ``/`` or ``/robot/talker``, and fits in a
    certificate.
    """
    from rosidl_py_gen.runtime import validate_namespace

    try:
        validate_namespace(name)
    except InvalidNameError as error:
        text = str(error).replace("invalid namespace", "invalid enclave name", 1)
        raise InvalidNameError(text, name=name, index=error.index, reason=error.reason) from None
    if len(name) > _MAX_COMMON_NAME:
        raise InvalidNameError(
            f"invalid enclave name {name!r:.300}: it has {len(name)} characters; the common name of a certificate has "
            f"at most {_MAX_COMMON_NAME}",
            name=name,
        )


def domain_id_from_environment() -> int:
    """Return the domain that permissions are made for: ``ROS_DOMAIN_ID``, else 0. Raises `EnvironmentSettingError`."""
    from rosidl_py_gen.runtime import read_environment

    return read_environment({"ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", "")}).domain_id
