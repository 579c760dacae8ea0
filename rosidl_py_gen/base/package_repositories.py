"""Repositories of well-known message packages that are neither bundled nor on the package index, for error texts.

`message_packages.txt` has the table of packages and repositories; nothing of it is downloaded.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rosidl_py_gen.base.distributions import Distribution

TABLE_FILE = Path(__file__).with_name("message_packages.txt")


@cache
def package_rows() -> dict[str, list[str]]:
    """Return the table of well-known message packages by package name: repository, branches and packages of that
    repository.

    Returns {} if the table cannot be read.
    """
    try:
        lines = TABLE_FILE.read_text(encoding="utf-8").splitlines()
    except OSError:
        return {}
    rows = [line.split() for line in lines if not line.startswith("#")]
    rows.sort(key=lambda row: "-" not in row)  # a repository may have a package in older distributions only
    return {package: row for row in rows for package in row[1 + len(Distribution.BUNDLED) :]}


class MessagePackage:
    """Message package that an error text or an installation names; its repository is known if the table has it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._row = package_rows().get(name)

    def branch(self, distro: str) -> tuple[str, str]:
        """Return the branch of the package, and its distribution.

        If the package has no branch for `distro`, the branch of the next older distribution is returned, or else of the
        next newer. The branch of an unknown package has the name of the distribution.
        """
        if self._row is None:
            return distro, distro
        branches: list[str] = []
        for word in self._row[1 : 1 + len(Distribution.BUNDLED)]:
            branches.append(branches[-1] if word == "=" else word)
        wanted = Distribution.BUNDLED.index(distro)
        older, newer = range(wanted, -1, -1), range(wanted + 1, len(Distribution.BUNDLED))
        used = next(number for number in (*older, *newer) if branches[number] != "-")
        return branches[used], Distribution.BUNDLED[used]

    def download_note(self, distro: str) -> str:
        """Return a text about where the package can be found, with the commands to get and use it.

        Returns "" for an unknown package.
        """
        if self._row is None:
            return ""
        repository = self._row[0]
        url = repository if "://" in repository else f"https://github.com/{repository}"
        (branch, used), folder = self.branch(distro), url.rpartition("/")[2]
        instead = "" if used == distro else f" (of {used}; it has none for {distro})"
        return (
            f"{self.name} is in {url}, branch {branch}{instead}: git clone --depth 1 --branch {branch} {url}; then use "
            f"--path {folder} (in Python path=), or install it: "
            f"rosidl-py-gen --path {folder} --filter {self.name} --install"
        )
