"""Message packages in this Python's environment: installed by pip, and taken back by it.

Decides that nothing of others is touched: a package that is importable and not ours, or a ROS installation, is a reason
to refuse; and what somebody changed in an installed package is told before it goes.
"""

from __future__ import annotations

import base64
import hashlib
import re
import subprocess
import sys
from importlib.metadata import Distribution, distributions
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rosidl_py_gen.base.generated_files import is_generated
from rosidl_py_gen.base.resources import ENTRY_POINTS
from rosidl_py_gen.errors import OutputError
from rosidl_py_gen.wheels.build import build

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

_MAX_SHOWN = 10


def installed_packages() -> dict[str, Distribution]:
    """The message packages that were installed as wheels of ours, by name of the ROS package."""
    found: dict[str, Distribution] = {}
    for one in distributions():
        for entry in one.entry_points:
            if entry.group == ENTRY_POINTS:
                found.setdefault(entry.name, one)
    return found


def install(search: SearchPath, packages: list[str], *, force: bool = False) -> list[str]:
    """Make wheels of packages and of what they use, and let pip install them into this Python's environment.

    Args:
        force: beside a ROS installation, and over packages of others.

    Returns:
        ``name version`` of each, as installed.

    Raises:
        OutputError: somebody else's packages are in the way, or pip refused; says what it said.
        DefinitionError: problems in definitions or manifests.
    """
    with TemporaryDirectory(prefix="rosidl-py-gen-install-") as folder:
        built = build(search, packages, Path(folder))
        if not force:
            _check_no_conflict([one.path.name.split("-")[0] for one in built])
        _pip("install", "--no-deps", "--no-index", "--force-reinstall", *(str(one.path) for one in built))
        return [" ".join(one.path.name.split("-")[:2]) for one in built]


def uninstall(packages: Sequence[str] = (), *, force: bool = False) -> list[str]:
    """Let pip remove message packages that were installed as wheels of ours; all of them when none is named.

    Raises:
        OutputError: no such package is installed, files of one were changed since, or pip refused.
    """
    known = installed_packages()
    for name in packages:
        if name not in known:
            raise OutputError(f"{name} is not installed as a wheel of rosidl-py-gen; there are {_listed(known)}")
    chosen = sorted({*packages} or {*known})
    if not chosen:
        return []
    if not force and (changed := [text for name in chosen for text in _modified_files(known[name])]):
        raise OutputError(f"changed since they were installed: {_listed(changed)}; --force removes them all the same")
    _pip("uninstall", "--yes", *(known[name].metadata["Name"] for name in chosen))
    return chosen


def _check_no_conflict(packages: list[str]) -> None:
    ours = {_normalized(one.metadata["Name"]) for one in installed_packages().values()}
    rclpy = find_spec("rclpy")
    if rclpy is not None and rclpy.origin is not None:  # a folder that is called so has none
        raise OutputError(
            f"rclpy is importable here, from {rclpy.origin}: its messages and ours have the same names, and one would "
            "hide the other; use a virtual environment without it, or --force"
        )
    for name in packages:
        spec = find_spec(name)
        if spec is None or _normalized(name) in ours:
            continue
        origin = Path(spec.origin) if spec.origin else None
        if origin is None or not is_generated(origin):
            raise OutputError(
                f"{name} is here already, from {spec.origin}, and not of rosidl-py-gen; --force replaces it"
            )


def _normalized(name: str) -> str:
    """Return a name as indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _modified_files(one: Distribution) -> list[str]:
    found = []
    for file in one.files or ():
        path = Path(str(file.locate()))
        if file.hash is None or not path.is_file():
            continue
        digest = hashlib.new(file.hash.mode, path.read_bytes()).digest()
        if file.hash.value != base64.urlsafe_b64encode(digest).rstrip(b"=").decode():
            found.append(str(path))
    return found


def _listed(texts: Iterable[str]) -> str:
    texts = list(texts)
    more = f" and {len(texts) - _MAX_SHOWN} more" if len(texts) > _MAX_SHOWN else ""
    return ", ".join(texts[:_MAX_SHOWN]) + more or "none"


def _pip(*arguments: str) -> None:
    if find_spec("pip") is None:
        raise OutputError(
            "this environment has no pip; make wheels with `rosidl-py-gen wheel --out dist` and install them with the "
            "tool that made it, such as `uv pip install dist/*.whl`"
        )
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip())[-2000:]
        raise OutputError(f"pip {arguments[0]} failed: {said}")
