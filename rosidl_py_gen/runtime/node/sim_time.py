"""When simulated time is used: the rules around the parameter `use_sim_time`, fed with values.

Decides which change of the parameter means what; subscribing and setting clocks is `time.py`.
Source: protocol.md 9.6.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.parameters.store import SetResult
from rosidl_py_gen.runtime.parameters.values import ParameterType

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.runtime.parameters.values import Parameter

USE_SIM_TIME = "use_sim_time"
NOT_BOOL_REASON = "use_sim_time parameter set to something besides a bool"


class SimTimeStep(Enum):
    """What has to be done after a change."""

    NOTHING = "nothing"
    START = "subscribe to /clock and override the ROS clocks"
    STOP = "drop the subscription and follow the system clock"


def check_use_sim_time(parameters: Iterable[Parameter]) -> SetResult:
    """An on-set callback: refuses a value that is no bool."""
    for parameter in parameters:
        if parameter.name == USE_SIM_TIME and parameter.value.type is not ParameterType.BOOL:
            return SetResult(False, NOT_BOOL_REASON)
    return SetResult(True)


class SimTimeRule:
    """Remembers whether simulated time is on, so that setting the same value again does nothing."""

    def __init__(self) -> None:
        self.active = False

    def after_set(self, parameters: Iterable[Parameter]) -> SimTimeStep:
        """What a successful set or declaration demands."""
        wanted = self.active
        for parameter in parameters:
            if parameter.name == USE_SIM_TIME:
                wanted = parameter.value.value is True
        if wanted == self.active:
            return SimTimeStep.NOTHING
        self.active = wanted
        return SimTimeStep.START if wanted else SimTimeStep.STOP
