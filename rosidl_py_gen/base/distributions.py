"""ROS 2 distributions whose definitions are bundled, and the selection of the distribution that this process uses.

A distribution is selected for a call (``distro=``), for a command (``--distro``), or for a process (ROS_DISTRO). The
first two are explicit: definitions of that distribution precede definitions of AMENT_PREFIX_PATH and of installed
wheels.
"""

from __future__ import annotations

import os
import warnings
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.errors import DistributionWarning, UnknownDistributionError, printable

if TYPE_CHECKING:
    from collections.abc import Iterator

_SAME_AS = {"rolling": "lyrical"}
_command_selections: list[str] = []
"""Distributions that commands running in this process have selected by `Distribution.of_command`; the last one counts.
Tasks in several threads select the same distribution."""
_reported: set[str] = set()


class _Choice(NamedTuple):
    name: str
    is_explicit: bool


class Distribution(_Choice):
    """Selected distribution of ROS 2, and the names of all distributions that can be selected.

    Attributes:
        name: name of the distribution, one of `BUNDLED`.
        is_explicit: False if the distribution is the default or comes from ROS_DISTRO.
    """

    __slots__ = ()

    BUNDLED = ("humble", "jazzy", "kilted", "lyrical")
    """Names of the ROS 2 distributions whose definitions are bundled, oldest first."""
    DEFAULT = "jazzy"
    """Distribution that is used without a selection. Its definitions are stored in full, other distributions as
    differences."""
    NAMES = (*BUNDLED, *_SAME_AS)
    """Names with which users can select a distribution."""
    VARIABLE = "ROS_DISTRO"
    """Environment variable that selects a distribution for a process."""
    ASSUMED_VARIABLE = "ROSIDL_PY_GEN_ASSUMED_DISTRO"
    """Environment variable in which `rosidl-py run`, or a setup script of a prefix, records the value to which it has
    set ROS_DISTRO."""

    @classmethod
    def selected(cls, distro: str | None = None) -> Distribution:
        """Return the distribution that a call uses: `distro`, else the command's, else ROS_DISTRO, else the default.

        Raises:
            UnknownDistributionError: the definitions of `distro` are not bundled; ROS_DISTRO causes only a warning.
        """
        if distro is not None:
            return cls(_checked(distro), True)
        if _command_selections:
            return cls(_command_selections[-1], True)
        name = os.environ.get(cls.VARIABLE, "")
        if not name:
            return _DEFAULT_CHOICE
        found = _find(name)
        if found is None:
            if name not in _reported:
                _reported.add(name)
                unknown = printable(repr(name), 60)
                text = f"{cls.VARIABLE}: no definitions of {unknown}; using the definitions of {cls.DEFAULT}"
                warnings.warn(DistributionWarning(f"{text}. Known: {_expected()}"), stacklevel=3)
            found = cls.DEFAULT
        return cls(found, False)

    @classmethod
    def name_for_node(cls) -> str | None:
        """Return the distribution that the running command has selected by `of_command`, for a node of the command.

        Returns None without a selection. Returns "" if ROS_DISTRO has the value that `rosidl-py run` or a setup script
        of a prefix has set.
        """
        if _command_selections:
            return _command_selections[-1]
        return "" if os.environ.get(cls.VARIABLE) == os.environ.get(cls.ASSUMED_VARIABLE, "") else None

    @staticmethod
    @contextmanager
    def of_command(distro: str) -> Iterator[None]:
        """Select a distribution inside the block, as a command's option ``--distro`` does, for all calls without
        ``distro=``.
        """
        name = _checked(distro)
        _command_selections.append(name)
        try:
            yield
        finally:
            del _command_selections[len(_command_selections) - 1 - _command_selections[::-1].index(name)]

    def is_since(self, distro: str) -> bool:
        """Return True if the selected distribution is `distro` or a later one."""
        return self.BUNDLED.index(self.name) >= self.BUNDLED.index(distro)


_DEFAULT_CHOICE = Distribution(Distribution.DEFAULT, False)


def _checked(name: str) -> str:
    """Return a distribution's name in lower case, with ``rolling`` replaced by the newest distribution.

    Raises `UnknownDistributionError` if the definitions of the distribution are not bundled.
    """
    found = _find(name) if isinstance(name, str) else None
    if found is None:
        text = f"no definitions of the ROS distribution {printable(repr(name), 60)}; expected {_expected()}"
        raise UnknownDistributionError(text)
    return found


def _find(name: str) -> str | None:
    lower = name.strip().lower()
    lower = _SAME_AS.get(lower, lower)
    return lower if lower in Distribution.BUNDLED else None


def _expected() -> str:
    return ", ".join(Distribution.NAMES)
