"""Installation of message packages into this Python environment by pip, or by uv if the environment has no pip.

Without ``--force``, an installation is refused if it conflicts with a package of another tool or with a ROS
installation, and a package with modified files is not uninstalled.
"""

from __future__ import annotations

import base64
import hashlib
import re
from importlib.metadata import Distribution, distributions
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rosidl_py_gen.base.generated_classes import is_generated
from rosidl_py_gen.base.resources import ENTRY_POINTS
from rosidl_py_gen.errors import OutputError
from rosidl_py_gen.wheels.build import build
from rosidl_py_gen.wheels.installer import find_installer

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

_MAX_LISTED = 10


def installed_packages() -> dict[str, Distribution]:
    """Return the distributions of message packages that are installed in this environment, by ROS package name."""
    found: dict[str, Distribution] = {}
    for one in distributions():
        for entry in one.entry_points:
            if entry.group == ENTRY_POINTS:
                found.setdefault(entry.name, one)
    return found


def install(search: SearchPath, packages: list[str], *, force: bool = False) -> list[str]:
    """Make wheels of packages and of their dependencies, install them, and return ``name version`` of each.

    With `force`, packages of other tools are replaced, and an importable rclpy is no error.

    Raises:
        OutputError: rclpy or a package of another tool conflicts, the environment has no pip or uv, or it failed.
        DefinitionError: a definition or package.xml is missing or invalid.
    """
    installer = find_installer()
    with TemporaryDirectory(prefix="rosidl-py-gen-install-") as folder:
        built = build(search, packages, Path(folder))
        if not force:
            _check_no_conflict([one.path.name.split("-")[0] for one in built])
        installer.install(*(one.path for one in built))
        return [" ".join(one.path.name.split("-")[:2]) for one in built]


def uninstall(packages: Sequence[str] = (), *, force: bool = False) -> list[str]:
    """Uninstall message packages (all if `packages` is empty), modified ones only with `force`; return their names.

    Raises `OutputError` if a package is not installed or has modified files, or pip or uv is missing or failed.
    """
    known = installed_packages()
    for name in packages:
        if name not in known:
            raise OutputError(f"{name} is not installed as a wheel of rosidl-py-gen; expected one of {_listed(known)}")
    chosen = sorted({*packages} or {*known})
    if not chosen:
        return []
    if not force and (changed := [text for name in chosen for text in _modified_files(known[name])]):
        raise OutputError(f"modified since the installation: {_listed(changed)}; --force removes them")
    find_installer().uninstall(*(known[name].metadata["Name"] for name in chosen))
    return chosen


def _check_no_conflict(packages: list[str]) -> None:
    own = {_normalized(one.metadata["Name"]) for one in installed_packages().values()}
    rclpy = find_spec("rclpy")
    if rclpy is not None and rclpy.origin is not None:  # a plain folder of this name has no origin
        raise OutputError(
            f"rclpy is importable from {rclpy.origin}: its message packages have the same names and would conflict; "
            "use a virtual environment without it, or --force"
        )
    for name in packages:
        spec = find_spec(name)
        if spec is None or _normalized(name) in own:
            continue
        origin = Path(spec.origin) if spec.origin else None
        if origin is None or not is_generated(origin):
            raise OutputError(f"{name} is importable from {spec.origin}, and not of rosidl-py-gen; --force replaces it")


def _normalized(name: str) -> str:
    """Return the name of a distribution in the form in which package indexes compare names (PEP 503)."""
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
    more = f" and {len(texts) - _MAX_LISTED} more" if len(texts) > _MAX_LISTED else ""
    return ", ".join(texts[:_MAX_LISTED]) + more or "none"
