"""ROS 2 distributions whose definitions are bundled, and the one that this process uses.

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

DISTRIBUTIONS = ("humble", "jazzy", "kilted", "lyrical")
"""Names of the distributions, oldest first."""
DEFAULT = "jazzy"
"""Distribution without a selection. Its definitions are stored in full, other distributions as differences."""
ENVIRONMENT_VARIABLE = "ROS_DISTRO"
_BASES = {"humble": DEFAULT, "kilted": DEFAULT, "lyrical": "kilted"}
"""For each other distribution, the one that its stored differences are relative to."""
_SAME_AS = {"rolling": "lyrical"}
NAMES = (*DISTRIBUTIONS, *_SAME_AS)
"""Names that select a distribution."""
_command_selections: list[str] = []
"""Selections of `distribution_of_command`, the last one counts; tasks in several threads select the same."""
_reported: set[str] = set()


class DistributionChoice(NamedTuple):
    """Selected distribution; `is_explicit` is False if it is the default or comes from ROS_DISTRO."""

    name: str
    is_explicit: bool


_DEFAULT_CHOICE = DistributionChoice(DEFAULT, False)
ASSUMED_VARIABLE = "ROSIDL_PY_GEN_ASSUMED_DISTRO"
"""Environment variable with the value of ROS_DISTRO that `rosidl-py run` or a setup script of a prefix has set."""


def checked_distribution(name: str) -> str:
    """Return a distribution in lower case, the newest for ``rolling``; raises `UnknownDistributionError`."""
    found = _find(name) if isinstance(name, str) else None
    if found is None:
        text = f"no definitions of the ROS distribution {printable(repr(name), 60)}; expected {_expected()}"
        raise UnknownDistributionError(text)
    return found


def selected(distro: str | None = None) -> DistributionChoice:
    """Return the distribution of a call: `distro`, else the command's, else ROS_DISTRO, else the default.

    Raises:
        UnknownDistributionError: the definitions of `distro` are not bundled; ROS_DISTRO causes only a warning.
    """
    if distro is not None:
        return DistributionChoice(checked_distribution(distro), True)
    if _command_selections:
        return DistributionChoice(_command_selections[-1], True)
    name = os.environ.get(ENVIRONMENT_VARIABLE, "")
    if not name:
        return _DEFAULT_CHOICE
    found = _find(name)
    if found is None:
        if name not in _reported:
            _reported.add(name)
            text = f"{ENVIRONMENT_VARIABLE}: no definitions of {printable(repr(name), 60)}; using those of {DEFAULT}"
            warnings.warn(DistributionWarning(f"{text}. Known: {_expected()}"), stacklevel=3)
        found = DEFAULT
    return DistributionChoice(found, False)


def is_selected_since(distro: str) -> bool:
    """Return True if `selected` without an argument is a distribution or a later one."""
    return DISTRIBUTIONS.index(selected().name) >= DISTRIBUTIONS.index(distro)


def command_distribution() -> str | None:
    """Return the distribution of `distribution_of_command`; outside of it None, or "" if ROS_DISTRO has the default."""
    if _command_selections:
        return _command_selections[-1]
    return "" if os.environ.get(ENVIRONMENT_VARIABLE) == os.environ.get(ASSUMED_VARIABLE, "") else None


@contextmanager
def distribution_of_command(distro: str) -> Iterator[None]:
    """Select a distribution explicitly for all calls without ``distro=`` inside the block."""
    name = checked_distribution(distro)
    _command_selections.append(name)
    try:
        yield
    finally:
        del _command_selections[len(_command_selections) - 1 - _command_selections[::-1].index(name)]


def layers(distro: str) -> list[str]:
    """Return the distributions whose stored differences lead from the default to a distribution, in order."""
    found: list[str] = []
    while distro != DEFAULT:
        found.insert(0, distro)
        distro = _BASES[distro]
    return found


def _find(name: str) -> str | None:
    lower = name.strip().lower()
    lower = _SAME_AS.get(lower, lower)
    return lower if lower in DISTRIBUTIONS else None


def _expected() -> str:
    return ", ".join(NAMES)
