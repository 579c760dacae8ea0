"""Installation of launch, launch_ros and other Python packages of ROS, from archives of GitHub or from clones.

Each package becomes a wheel with the files that a build would install, and pip or uv installs the wheel. Code of the
packages does not run. A file in the environment, `ORIGINS`, states where each package is from.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from configparser import ConfigParser
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from http.client import HTTPException
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen
from zipfile import BadZipFile, ZipFile

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.package_repositories import MessagePackage
from rosidl_py_gen.base.terminal_text import print_next_step
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.compiler.frontend import SearchPath, Workspace
from rosidl_py_gen.errors import DefinitionError, OutputError, display_path
from rosidl_py_gen.generator_cli import clone_origin
from rosidl_py_gen.prefix.environment import SITE_PACKAGES
from rosidl_py_gen.prefix.launch_packages import LAUNCH_PACKAGES, MESSAGES, REPOSITORIES, repository_of
from rosidl_py_gen.prefix.package_plan import PROGRAM, PackagePlan
from rosidl_py_gen.wheels import Installer, PackageManifest

ARCHIVE = "https://github.com/{repository}/archive/refs/heads/{branch}.zip"
"""Address of the archive of a repository's branch. git writes the hash of the commit as comment of the archive."""
ORIGINS = "share/rosidl_py_gen/origins"
"""Folder in the Python environment that has a file ``PACKAGE.json`` for each installed package, with the package's
origin."""
_DOWNLOAD_TIMEOUT_S = 60
"""Maximum time in seconds without data from the server during a download."""
_MAX_ARCHIVE_BYTES = 512 << 20
"""Maximum size in bytes of a downloaded archive; the archive of navigation2, with maps and pictures, has 60 MB."""
_MAX_PACKAGE_BYTES = 64 << 20
"""Maximum size in bytes of all files that are extracted from one archive."""
_CHUNK_BYTES = 1 << 16
_EXTRA = "launch"
_REQUIREMENTS = {"osrf_pycommon": "osrf-pycommon", "packaging": "packaging", "yaml": "pyyaml"}
"""Requirements of the extra `_EXTRA` by the modules that launch imports; used if the extra's metadata are missing."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Source of an installed package, written to a file in the environment.

    Attributes:
        address: URL of the archive or of the clone's remote, or the folder.
        branch: branch of the archive; empty for a folder.
        commit: hash of the commit; empty if unknown.
        sha256: SHA-256 of the archive; empty for a folder.
        folder: folder of the package on this machine; empty for an archive.
    """

    name: str
    address: str
    branch: str = ""
    commit: str = ""
    sha256: str = ""
    folder: str = ""
    version: str = ""
    distribution: str = field(default_factory=lambda: Distribution.selected().name)

    @property
    def text(self) -> str:
        """Name, version, address, branch and commit of the installed package as one line of text."""
        branch = f", branch {self.branch}" if self.branch else ""
        folder = f", {self.folder}" if self.folder and self.folder != self.address else ""
        return f"{self.name} {self.version}: {self.address}{branch}{folder}, commit {self.commit or 'unknown'}"


@dataclass(frozen=True, slots=True)
class _PackageSource:
    """Source folder of a package to install, with the origin of the folder."""

    folder: Path
    origin: Origin


def install_ros_packages(names: Sequence[str], clones: Sequence[str]) -> None:
    """Install Python packages of ROS into this Python environment, and print the origin of each.

    Args:
        names: names of packages; empty for those that ``rosidl-py launch`` needs.
        clones: folders with clones of the repositories; empty to download archives.

    Raises:
        CommandError: a name is unknown, an archive cannot be downloaded, or a clone lacks a package.
        OutputError: the environment has no pip or uv, or it failed.
    """
    for name in names:
        if not repository_of(name):
            known = [one for packages in REPOSITORIES.values() for one in packages]
            raise CommandError(f'no package "{name}"{did_you_mean(name, known)}; expected {", ".join(known)}')
    installer = Installer.of_environment()  # before the download
    missing = [name for name in LAUNCH_PACKAGES if find_spec(name) is None]
    chosen = [*dict.fromkeys((*missing, *names))] if names else [*LAUNCH_PACKAGES]
    with TemporaryDirectory(prefix="rosidl-py-launch-") as folder, _sources(chosen, clones, Path(folder)) as sources:
        wheels = Path(folder, "wheels")
        wheels.mkdir()
        built = [_build(sources[name], wheels) for name in chosen]
        installer.install(*(path for path, _ in built))
        for _, origin in built:
            terminal_output.line(origin.text)
        _install_requirements(installer)
        _install_messages([name for name in _messages(chosen) if name in sources], sources)
    if not names:
        print_next_step("rosidl-py launch PACKAGE FILE")


def _messages(names: Iterable[str]) -> dict[str, str]:
    """Return the message packages that some packages import and that are not bundled, each with its repository."""
    return {
        message: repository
        for name in names
        for repository, packages in MESSAGES.get(name, {}).items()
        for message in packages
    }


def _install_requirements(installer: Installer) -> None:
    """Install the modules of the package index that launch needs, unless they are installed."""
    if all(map(find_spec, _REQUIREMENTS)):
        return
    requirements = Extra(_EXTRA).requirements() or [*_REQUIREMENTS.values()]
    try:
        installer.require(*requirements)
    except OutputError as error:
        text = f"{', '.join(requirements)} of the package index, which launch needs: {' '.join(str(error).split())}"
        raise OutputError(text) from error
    terminal_output.line(f"{', '.join(requirements)}: from the package index")


def _install_messages(packages: list[str], sources: dict[str, _PackageSource]) -> None:
    """Install message packages of clones or archives as ``rosidl-py-gen --install`` does, and print their origins."""
    if not packages:
        return
    try:
        search = SearchPath.scan(tuple(str(sources[name].folder) for name in packages))
        made = dict(one.split(" ") for one in Installer.install_packages(search, packages))
    except (DefinitionError, OutputError) as error:
        text = str(error.diagnostics[0] if isinstance(error, DefinitionError) else error)
        terminal_output.note(f"warning: the messages {', '.join(packages)} are not installed: {' '.join(text.split())}")
        return
    for name in packages:
        terminal_output.line(replace(sources[name].origin, version=made.pop(name, "")).text)
    if others := ", ".join(" ".join(one) for one in made.items()):
        terminal_output.line(f"bundled messages that these use: {others}")


# --- sources ----------------------------------------------------------------------------------------------------------


@contextmanager
def _sources(names: Sequence[str], clones: Sequence[str], folder: Path) -> Iterator[dict[str, _PackageSource]]:
    """Yield the sources of packages, and of their message packages if these exist, by name."""
    messages = _messages(names)
    if clones:
        yield _from_clones(names, [*names, *messages], clones)
        return
    distro = Distribution.selected().name
    by_branch: dict[tuple[str, str], list[str]] = {}
    for name, repository in ({name: repository_of(name) for name in names} | messages).items():
        by_branch.setdefault((repository, MessagePackage(name).branch(distro)[0]), []).append(name)
    found: dict[str, _PackageSource] = {}
    for number, ((repository, branch), packages) in enumerate(by_branch.items()):
        found |= _from_archive(repository, branch, packages, folder / str(number))
    yield found


def _from_clones(names: Sequence[str], wanted: Sequence[str], clones: Sequence[str]) -> dict[str, _PackageSource]:
    packages: dict[str, Path] = {}
    for clone in clones:
        if not os.path.isdir(clone):
            raise CommandError(f"{clone}: expected a folder with clones of {_repositories(names)}, found no folder")
        packages = Workspace(Path(os.path.abspath(clone))).packages | packages
    if absent := [name for name in names if name not in packages]:
        searched = ", ".join(map(display_path, clones))
        text = f"{searched}: no package {', '.join(absent)}; expected clones of {_repositories(absent)}"
        raise CommandError(f"{text}, branch {Distribution.selected().name}")
    found = {}
    for name in wanted:
        if name in packages:
            address, commit = clone_origin(packages[name])
            origin = Origin(name, address or str(packages[name]), commit=commit, folder=str(packages[name]))
            found[name] = _PackageSource(packages[name], origin)
    return found


def _repositories(names: Iterable[str]) -> str:
    return " and ".join(dict.fromkeys(f"https://github.com/{repository_of(name)}" for name in names))


def _from_archive(repository: str, branch: str, names: Sequence[str], folder: Path) -> dict[str, _PackageSource]:
    """Download the archive of a branch, and extract the folders of packages."""
    address = ARCHIVE.format(repository=repository, branch=branch)
    folder.mkdir()
    file = folder / "archive.zip"
    with file.open("w+b") as opened:
        digest = _download(address, opened, repository, branch)
        try:
            with ZipFile(opened) as archive:
                places = _extract(archive, names, folder, address)
                comment = archive.comment.decode("ascii", "replace")
        except (BadZipFile, NotImplementedError, RuntimeError) as error:
            raise CommandError(f"{address}: expected a zip archive: {error}") from error
    file.unlink()
    commit = comment if re.fullmatch(r"[0-9a-f]{40,64}", comment) else ""
    return {
        name: _PackageSource(place, Origin(name, f"https://github.com/{repository}", branch, commit, digest))
        for name, place in places.items()
    }


def _download(address: str, file: IO[bytes], repository: str, branch: str) -> str:
    """Write the data of a URL to a file, and return the SHA-256; raises `CommandError`."""
    digest, size = sha256(), 0
    try:
        with urlopen(Request(address, headers={"User-Agent": "rosidl-py-gen"}), timeout=_DOWNLOAD_TIMEOUT_S) as reply:
            while data := reply.read(_CHUNK_BYTES):
                size += len(data)
                if size > _MAX_ARCHIVE_BYTES:
                    raise CommandError(f"{address}: expected at most {_MAX_ARCHIVE_BYTES} bytes, found more")
                digest.update(data)
                file.write(data)
    except (OSError, HTTPException, ValueError) as error:
        if isinstance(error, HTTPError):
            reason = f"HTTP status {error.code}" + (f", no branch {branch}" if error.code == 404 else "")
        else:
            cause = error.reason if isinstance(error, URLError) else error
            reason = (cause.strerror if isinstance(cause, OSError) else "") or str(cause) or type(cause).__name__
        raise CommandError(
            f"{address}: cannot be downloaded: {reason}; without a network, pass a folder with a clone: "
            f"git clone --branch {branch} https://github.com/{repository}; "
            "rosidl-py launch --install --launch-from FOLDER"
        ) from error
    return digest.hexdigest()


def _extract(archive: ZipFile, names: Sequence[str], folder: Path, address: str) -> dict[str, Path]:
    """Extract the folders of packages, which are at the top of the repository, and return them by name."""
    tops = {name.partition("/")[0] for name in archive.namelist()}
    if len(tops) != 1:
        raise CommandError(f"{address}: expected an archive with one folder, found {len(tops)}")
    prefixes = tuple(f"{next(iter(tops))}/{name}/" for name in names)
    members = [one for one in archive.infolist() if one.filename.startswith(prefixes)]
    if sum(one.file_size for one in members) > _MAX_PACKAGE_BYTES:
        raise CommandError(f"{address}: expected packages of at most {_MAX_PACKAGE_BYTES} bytes")
    archive.extractall(folder, members)
    places = {name: folder.joinpath(*prefix.split("/")) for name, prefix in zip(names, prefixes, strict=True)}
    if absent := [name for name, place in places.items() if not (place / "package.xml").is_file()]:
        raise CommandError(f"{address}: has no folder {', '.join(absent)} with a package.xml")
    return places


# --- wheels -----------------------------------------------------------------------------------------------------------


def _build(source: _PackageSource, out: Path) -> tuple[Path, Origin]:
    """Build the wheel of a package from the files that a build would install; return its path and the origin."""
    name, manifest = source.origin.name, PackageManifest.read(source.folder)
    origin = replace(source.origin, version=manifest.version)
    plan = PackagePlan(name, source.folder)
    if texts := (*plan.problems, *plan.notes):
        raise CommandError(f"{name} of {origin.address} cannot be installed: {texts[0]}")
    groups: dict[str, dict[str, str]] = {}
    code: dict[str, bytes] = {}
    data = {f"{ORIGINS}/{name}.json": f"{json.dumps(asdict(origin), indent=2)}\n".encode()}
    programs = []
    for place, file in plan.files.items():
        inner = place.removeprefix(f"{SITE_PACKAGES}/")
        if inner == place:
            data[place] = (file.content or b"") if file.source is None else file.source.read_bytes()
            programs += [place] if file.mode == PROGRAM else []
        elif inner.endswith(".dist-info/entry_points.txt"):
            groups = _entry_points((file.content or b"").decode())
        elif file.source is not None:
            code |= _module_files(inner, file.source)
    if f"{name}/__init__.py" not in code:
        raise CommandError(f"{name} of {origin.address} has no Python package {name}")
    return manifest.write_wheel(out, name, code, groups, data, programs), origin


def _module_files(place: str, source: Path) -> dict[str, bytes]:
    """Return the contents of a module or a folder of modules, by path below site-packages."""
    if source.is_file():
        return {place: source.read_bytes()}
    paths = (path for path in sorted(source.rglob("*")) if path.is_file() and "__pycache__" not in path.parts)
    return {f"{place}/{path.relative_to(source).as_posix()}": path.read_bytes() for path in paths}


def _entry_points(text: str) -> dict[str, dict[str, str]]:
    """Return the entry points of a file entry_points.txt by group and name."""
    parser = ConfigParser(delimiters=("=",), interpolation=None, strict=False)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(text)
    return {group: dict(parser[group]) for group in parser.sections()}
