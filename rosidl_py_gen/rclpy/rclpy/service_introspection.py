"""How much is published of what passes services."""

from __future__ import annotations

from enum import IntEnum


class ServiceIntrospectionState(IntEnum):
    """Nothing, who and when, or requests and responses themselves, too."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2
