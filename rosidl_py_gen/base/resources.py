"""Where the files that are not Python live: the grammar beside the code, templates and interfaces in wheel or checkout.
And how the package came here, so that what has to be installed besides can come the same way.

In a wheel `templates/` and `interfaces/` travel inside the package; in a checkout (editable install) they are at the
top.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import ExtraMissingError

if TYPE_CHECKING:
    from importlib.metadata import Distribution

ENTRY_POINTS = "rosidl_py_gen.interfaces"
"""Group of entry points by which installed packages say that they hold definitions; names are those of ROS packages."""
_PACKAGE = Path(__file__).resolve().parents[1]
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
    "duckdb": "tables",
    "fsspec": "tables",
    "upath": "tables",
    "distributed": "cluster",
    "PIL": "images",
    "transforms3d": "transformations",
}
"""Modules that only extras bring."""


def grammar_text(name: str) -> str:
    """The text of a grammar file in `compiler/frontend/`."""
    return (_PACKAGE / "compiler" / "frontend" / name).read_text(encoding="utf-8")


def templates_dir() -> Path:
    """The folder of the jinja templates."""
    return _find("templates")


def compiled_templates_dir() -> Path:
    """The folder of what jinja2 makes of them; only wheels have one."""
    return _PACKAGE / "compiled_templates"


def interfaces_dir() -> Path:
    """The folder of the bundled interface packages."""
    return _find("interfaces")


def _find(name: str) -> Path:
    inside = _PACKAGE / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


# ------------------------------------------------------------------------------------------------ how it was installed


def missing_extra_message(error: ImportError) -> ExtraMissingError | None:
    """What to say of a module that is not there; None when no extra brings it."""
    name = (error.name or "").partition(".")[0]
    if name not in _EXTRA_OF:
        return None
    text = f"this needs {name}, which is not installed: {install_command(_EXTRA_OF[name])}"
    return ExtraMissingError(text, name=name)


def require_modules(*modules: str) -> None:
    """Raise `ExtraMissingError` for the first of these modules that is not there.

    What needs several extras asks so for the one that brings the others, before it imports anything.
    """
    from importlib.util import find_spec

    for name in modules:
        if find_spec(name) is None:
            raise missing_extra_message(ModuleNotFoundError(name=name)) or ModuleNotFoundError(name=name)


def install_command(extra: str) -> str:
    """The command that installs an extra the way that this package was: from a folder, a wheel, a URL or an index.

    Where that is gone, it names what the extra consists of.
    """
    import json  # these take a while, and only errors need them
    import shlex
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        found = distribution(_NAME)
        told = json.loads(found.read_text("direct_url.json") or "null")
    except (PackageNotFoundError, ValueError):  # a checkout on the path, or something broken
        found, told = None, None
        if (_PACKAGE.parent / "pyproject.toml").is_file():
            return f"pip install -e {shlex.quote(f'{_PACKAGE.parent}[{extra}]')}"
    if not isinstance(told, dict):
        return f"pip install '{_NAME}[{extra}]'"
    return _from_url(told, extra) or f"pip install {' '.join(map(shlex.quote, _requirements(found, extra)))}"


def _from_url(told: dict[str, Any], extra: str) -> str:
    """By PEP 610; empty when there is nothing any more."""
    import shlex
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    url = str(told.get("url", ""))
    if "vcs_info" in told:
        info = told["vcs_info"]
        return f"pip install '{_NAME}[{extra}] @ {info.get('vcs', 'git')}+{url}@{info.get('commit_id', 'HEAD')}'"
    if urlsplit(url).scheme != "file":
        return f"pip install '{_NAME}[{extra}] @ {url}'" if url else ""
    path = url2pathname(urlsplit(url).path)
    if not Path(path).exists():
        return ""
    editable = "-e " if told.get("dir_info", {}).get("editable") else ""
    return f"pip install {editable}{shlex.quote(f'{path}[{extra}]')}"


def _requirements(found: Distribution | None, extra: str) -> list[str]:
    """What the metadata say that an extra needs; extras of our own in it are followed."""
    import re

    needed = []
    for line in (found.requires or ()) if found else ():
        requirement, _, marker = line.partition(";")
        where, count = re.subn(rf"(^| and) *extra == ['\"]{extra}['\"]", "", marker)
        if count:
            ours = re.match(rf"{_NAME}\[(.*)\]", requirement)
            plain = f"{requirement.strip()}; {where.strip()}" if where.strip() else requirement.strip()
            more = [_requirements(found, one) for one in ours[1].split(",")] if ours else [[plain]]
            needed += [one for part in more for one in part]
    return needed
