"""Repositories of well-known message packages, for the texts of errors. Nothing is downloaded."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rosidl_py_gen.base.distributions import DISTRIBUTIONS

_FILE = Path(__file__).with_name("message_packages.txt")
_GITHUB = "https://github.com/"


@cache
def _lines() -> dict[str, list[str]]:
    """Return repository, branches and packages by package; a file that cannot be read has none."""
    try:
        text = _FILE.read_text(encoding="utf-8")
    except OSError:
        return {}
    rows = [line.split() for line in text.splitlines() if not line.startswith("#")]
    found: dict[str, list[str]] = {}
    for row in rows:
        for package in row[1 + len(DISTRIBUTIONS) :]:
            if package not in found or "-" in found[package]:  # a repository may have it in older distributions only
                found[package] = row
    return found


def download_note(package: str, distro: str) -> str:
    """Return where a well-known package is, and the commands to get and use it; empty for an unknown package.

    If the package has no branch for the distribution, that of the next older one is named, else of the next newer one.
    """
    row = _lines().get(package)
    if row is None:
        return ""
    url = row[0] if "://" in row[0] else _GITHUB + row[0]
    branches: dict[str, str] = {}
    for name, word in zip(DISTRIBUTIONS, row[1:], strict=False):
        branches[name] = [*branches.values()][-1] if word == "=" else word
    number = DISTRIBUTIONS.index(distro)
    in_order = (*reversed(DISTRIBUTIONS[: number + 1]), *DISTRIBUTIONS[number + 1 :])
    used = next(name for name in in_order if branches[name] != "-")
    branch, folder = branches[used], url.rpartition("/")[2]
    instead = "" if used == distro else f" (of {used}; it has none for {distro})"
    return (
        f"{package} is in {url}, branch {branch}{instead}: git clone --depth 1 --branch {branch} {url}; then use "
        f"--path {folder} (in Python path=), or install it: rosidl-py-gen --path {folder} --filter {package} --install"
    )
