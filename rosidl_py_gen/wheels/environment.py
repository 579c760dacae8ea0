"""Installation of message packages into this Python environment by pip, or by uv if the environment has no pip.

`Installer.of_environment` returns the program. Without ``--force``, an installation is refused if it conflicts with a
package of another tool or with a ROS installation, and a package with modified files is not uninstalled.
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import Distribution, distributions
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rosidl_py_gen.base.resources import GeneratedCode, InstalledInterfaces
from rosidl_py_gen.errors import OutputError
from rosidl_py_gen.wheels.build import build_wheels, with_bundled

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rosidl_py_gen.compiler.frontend import SearchPath

_MAX_OUTPUT_CHARS = 2000
"""Maximum number of characters of a failed installer's output that an error text quotes."""
_EPHEMERAL = "extends-environment"
"""Key of pyvenv.cfg that marks the temporary environments of ``uv run --with``."""


@dataclass(frozen=True, slots=True)
class Installer:
    """Program that installs packages into this Python environment: pip or uv."""

    name: str
    _install: tuple[str, ...]
    """Command line that installs wheels; the paths of the wheels are appended."""
    _uninstall: tuple[str, ...]
    """Command line that uninstalls distributions; their names are appended."""
    _require: tuple[str, ...]
    """Command line that installs requirements from the user's package index; the requirements are appended."""
    _unpack: tuple[str, ...]
    """Command line that downloads wheels from the user's package index; `unpack` appends target and requirements."""

    @classmethod
    def of_environment(cls) -> Installer:
        """Return an installer: pip of this environment, else uv.

        Raises `OutputError` if both are missing, or in a temporary environment.
        """
        if _is_ephemeral():
            raise OutputError(
                f"the environment {sys.prefix} is temporary: `uv run --with` made it for one command; expected an "
                "environment of your own, such as `uv venv` makes"
            )
        if find_spec("pip") is not None:
            pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input")
            return cls(
                "pip",
                (*pip, "install", "--no-deps", "--no-index", "--force-reinstall"),
                (*pip, "uninstall", "--yes"),
                (*pip, "install"),
                (*pip, "install", "--no-deps", "--only-binary=:all:", "--require-hashes"),
            )
        if uv := _uv():
            # Without a cache: uv links installed files to it, and a change of one would return with the next
            # installation.
            of_this = "--python", sys.executable, "--no-cache"
            return cls(
                "uv",
                (
                    *uv,
                    "pip",
                    "install",
                    *of_this,
                    "--no-deps",
                    "--no-index",
                    "--offline",
                    "--reinstall",
                    "--link-mode=copy",
                ),
                (*uv, "pip", "uninstall", *of_this),
                (*uv, "pip", "install", "--python", sys.executable),
                (
                    *uv,
                    "pip",
                    "install",
                    "--python",
                    sys.executable,
                    "--no-deps",
                    "--only-binary=:all:",
                    "--require-hashes",
                ),
            )
        raise OutputError(
            f"the environment {sys.prefix} has no pip, and there is no uv on PATH; expected one of them. "
            f"`{shlex.quote(sys.executable)} -m ensurepip` adds pip. Or make wheels with `rosidl-py-gen wheel --out "
            "dist` and install those with the tool of the environment"
        )

    def install(self, *wheels: Path) -> None:
        """Install wheels without their dependencies; raises `OutputError` with the output of pip or uv on failure."""
        self._run("install", *self._install, *map(str, wheels))

    def require(self, *requirements: str) -> None:
        """Install requirements from the user's package index.

        Raises `OutputError` with the output of pip or uv on failure.
        """
        self._run("install", *self._require, *requirements)

    def uninstall(self, *distributions: str) -> None:
        """Uninstall distributions by name; raises `OutputError` with the output of pip or uv on failure."""
        self._run("uninstall", *self._uninstall, *distributions)

    def unpack(self, requirements: Path, target: Path, python: str, abi: str, platform: str) -> None:
        """Download wheels for another Python version or platform, and unpack them into the folder `target`.

        Args:
            requirements: requirements.txt with a SHA-256 for each requirement.
            target: folder that pip or uv creates.
            python: version of Python, such as 3.13.
            abi: tag of the ABI, such as cp313; uv ignores it and uses the ABI of this interpreter with `python`.
            platform: tag of the platform, such as win_amd64; uv ignores it and uses the platform of this machine.

        Raises:
            OutputError: pip or uv failed, as without network or with a wrong SHA-256; the text quotes its output.
        """
        tags = () if self.name == "uv" else (f"--abi={abi}", *(f"--platform={one}" for one in platform.split(".")))
        self._run(
            "install",
            *self._unpack,
            f"--python-version={python}",
            *tags,
            "--target",
            str(target),
            "-r",
            str(requirements),
        )

    @classmethod
    def install_packages(cls, search: SearchPath, wanted: list[str], *, force: bool = False) -> list[str]:
        """Make wheels of packages and of their dependencies, install them, and return ``name version`` of each.

        Args:
            search: search path of the packages.
            wanted: names of packages; empty for all.
            force: replace packages of other tools, also if rclpy is importable.

        Raises:
            OutputError: rclpy or a package of another tool conflicts, the environment has no pip or uv, or it failed.
            DefinitionError: a package is not on the search path, or its package.xml or a definition is missing or
                invalid.
        """
        installer = cls.of_environment()
        search = with_bundled(search, wanted)
        with TemporaryDirectory(prefix="rosidl-py-gen-install-") as folder:
            built = build_wheels(search, wanted or [*search.packages], Path(folder))
            if not force:
                _check_no_conflict([one.path.name.split("-")[0] for one in built])
            installer.install(*(one.path for one in built))
            return [" ".join(one.path.name.split("-")[:2]) for one in built]

    @classmethod
    def uninstall_packages(cls, packages: Sequence[str] = (), *, force: bool = False) -> list[str]:
        """Uninstall message packages (all if `packages` is empty), and return their names.

        Modified packages are uninstalled only with `force`.

        Raises `OutputError` if a package is not installed or has modified files, or pip or uv is missing or failed.
        """
        known = installed_packages()
        for name in packages:
            if name not in known:
                raise OutputError(
                    f"{name} is not installed as a wheel of rosidl-py-gen; expected one of {_listed(known)}"
                )
        chosen = sorted({*packages} or {*known})
        if not chosen:
            return []
        if not force and (changed := [text for name in chosen for text in _modified_files(known[name])]):
            raise OutputError(f"modified since the installation: {_listed(changed)}; --force removes them")
        cls.of_environment().uninstall(*(known[name].metadata["Name"] for name in chosen))
        return chosen

    def _run(self, action: str, *command: str) -> None:
        # In an empty folder: ``python -m`` imports modules of the current folder first.
        with TemporaryDirectory(prefix="rosidl-py-gen-empty-") as empty:
            done = subprocess.run(command, cwd=empty, capture_output=True, text=True, check=False)
        if not done.returncode:
            return
        output = done.stderr.strip() or done.stdout.strip()
        if "externally" in output and "managed" in output:
            raise OutputError(
                f"the packages of {sys.executable} are managed by the system (PEP 668), so {self.name} refuses to "
                f"{action}; use a virtual environment: `python3 -m venv .venv && . .venv/bin/activate`"
            )
        raise OutputError(f"{self.name} {action} failed: {output[-_MAX_OUTPUT_CHARS:]}")


def _uv() -> tuple[str, ...]:
    """Return the command that runs uv, as a tuple of words: uv of this environment, else uv on PATH.

    Returns () if uv is not installed.
    """
    if find_spec("uv") is not None:
        return sys.executable, "-m", "uv"
    # Programs of the current folder, which Windows searches as well, and of relative folders are not trusted.
    folders = [one for one in os.get_exec_path() if os.path.isabs(one)]
    found = shutil.which("uv", path=os.pathsep.join(folders))
    return () if found is None or os.path.dirname(os.path.abspath(found)) == os.getcwd() else (found,)


def _is_ephemeral() -> bool:
    try:
        text = Path(sys.prefix, "pyvenv.cfg").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return any(line.partition("=")[0].strip() == _EPHEMERAL for line in text.splitlines())


_MAX_LISTED = 10


def installed_packages() -> dict[str, Distribution]:
    """Return the distributions of message packages that are installed in this environment, by ROS package name."""
    found: dict[str, Distribution] = {}
    for one in distributions():
        for entry in one.entry_points:
            if entry.group == InstalledInterfaces.ENTRY_POINTS:
                found.setdefault(entry.name, one)
    return found


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
        if origin is None or not GeneratedCode.is_generated(origin):
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
