"""Extras of this package: the modules that they install, and the commands that install them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rosidl_py_gen.errors import ExtraMissingError

if TYPE_CHECKING:
    from importlib.metadata import Distribution

_FOLDER = Path(__file__).resolve().parents[2]
"""Folder of this package and, in a checkout, of its pyproject.toml."""
_NAME = "rosidl-py-gen"
_EXTRA_OF = {
    "cyclonedds": "node",
    "rich": "node",
    "yaml": "node",
    "mcap": "mcap",
    "zstandard": "mcap",
    "lz4": "mcap",
    "websockets": "foxglove",
    "zenoh": "zenoh",
    "xxhash": "zenoh",
    "pyarrow": "tables",
    "dask": "tables",
    "loky": "tables",
    "duckdb": "tables",
    "fsspec": "tables",
    "upath": "tables",
    "distributed": "cluster",
    "cryptography": "security",
    "PIL": "images",
    "av": "video",
    "matplotlib": "plot",
    "plotext": "plot",
    "transforms3d": "transformations",
    "osrf_pycommon": "launch",
    "packaging": "launch",
}
"""Names of modules that an extra of this package installs, each with the name of the extra."""


class Extra:
    """Extra of this package, which pip installs with a name in brackets: ``pip install 'rosidl-py-gen[node]'``."""

    WITHOUT_WHEELS: ClassVar = {"lz4": (3, 15), "mcap": (3, 15), "zstandard": (3, 15)}
    """Modules that extras do not install, each with the first Python version without wheels for it in the package
    index."""

    def __init__(self, name: str) -> None:
        self.name = name

    @classmethod
    def missing_error(cls, error: ImportError) -> ExtraMissingError | None:
        """Return the error, with the installation command, for a failed import.

        Returns None if no extra installs the module.
        """
        name = (error.name or "").partition(".")[0]
        if name not in _EXTRA_OF:
            return None
        text = f"this needs {name}, which is not installed: {cls(_EXTRA_OF[name]).install_command()}"
        if sys.version_info[:2] >= cls.WITHOUT_WHEELS.get(name, (4, 0)):
            version = f"CPython {sys.version_info[0]}.{sys.version_info[1]}"
            text = (
                f"this needs mcap, which the extra leaves out on {version}, as lz4 and zstandard lack wheels for it "
                "yet: pip install --no-deps mcap (only recordings with LZ4 need more)"
                if name == "mcap"
                else f"this needs {name}, which has no wheel for {version} yet: use an older Python, or compile it by "
                f"`pip install {name}`, which needs a C compiler and the headers of Python"
            )
        return ExtraMissingError(text, name=name)

    @classmethod
    def require_modules(cls, *modules: str) -> None:
        """Raise `ExtraMissingError` for the first of the named modules that is not installed.

        A feature that needs several extras passes the module of the extra that includes the others.
        """
        from importlib.util import find_spec

        for name in modules:
            if find_spec(name) is None:
                raise cls.missing_error(ModuleNotFoundError(name=name)) or ModuleNotFoundError(name=name)

    def install_command(self) -> str:
        """Return the command that installs the extra from this package's own origin: a folder, a wheel, a URL or an
        index.

        If the origin does not exist any more, the command installs the requirements of the extra.
        """
        import json  # slow to import
        import shlex
        from importlib.metadata import PackageNotFoundError, distribution

        try:
            found = distribution(_NAME)
            origin = json.loads(found.read_text("direct_url.json") or "null")
        except (PackageNotFoundError, ValueError):  # a checkout on the path, or damaged metadata
            found, origin = None, None
            if (_FOLDER / "pyproject.toml").is_file():
                return f"pip install -e {shlex.quote(f'{_FOLDER}[{self.name}]')}"
        if not isinstance(origin, dict):
            return f"pip install '{_NAME}[{self.name}]'"
        if command := _from_url(origin, self.name):
            return command
        return f"pip install {' '.join(map(shlex.quote, _requirements(found, self.name)))}"

    def requirements(self) -> list[str]:
        """Return the requirements of the extra; [] in a checkout that is not installed."""
        from importlib.metadata import PackageNotFoundError, distribution

        try:
            return _requirements(distribution(_NAME), self.name)
        except PackageNotFoundError:
            return []


def _from_url(origin: dict[str, Any], extra: str) -> str:
    """Return the command that installs an extra from the place where this package was installed from (PEP 610).

    Returns "" if it does not exist any more.
    """
    import shlex
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    url = str(origin.get("url", ""))
    if "vcs_info" in origin:
        info = origin["vcs_info"]
        return f"pip install '{_NAME}[{extra}] @ {info.get('vcs', 'git')}+{url}@{info.get('commit_id', 'HEAD')}'"
    if urlsplit(url).scheme != "file":
        return f"pip install '{_NAME}[{extra}] @ {url}'" if url else ""
    path = url2pathname(urlsplit(url).path)
    if not Path(path).exists():
        return ""
    editable = "-e " if origin.get("dir_info", {}).get("editable") else ""
    return f"pip install {editable}{shlex.quote(f'{path}[{extra}]')}"


def _requirements(found: Distribution | None, extra: str) -> list[str]:
    """Return the requirements of an extra, and of the extras it includes, from the installed package's metadata."""
    import re

    needed = []
    for line in (found.requires or ()) if found else ():
        requirement, _, marker = line.partition(";")
        where, count = re.subn(rf"(^| and) *extra == ['\"]{extra}['\"]", "", marker)
        if count:
            included = re.match(rf"{_NAME}\[(.*)\]", requirement)
            plain = f"{requirement.strip()}; {where.strip()}" if where.strip() else requirement.strip()
            more = [_requirements(found, one) for one in included[1].split(",")] if included else [[plain]]
            needed += [one for part in more for one in part]
    return needed
