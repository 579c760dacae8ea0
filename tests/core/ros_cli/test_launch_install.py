"""``rosidl-py launch --install``: wheels of launch and other Python packages of ROS, from archives and clones."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import ZipFile

import pytest
from support.interface_packages import write

from rosidl_py_gen.base.package_repositories import LAUNCH_PACKAGES, install_note
from rosidl_py_gen.prefix import launch_install
from rosidl_py_gen.wheels.environment import Installer

if TYPE_CHECKING:
    from collections.abc import Callable

    RunHere = Callable[..., tuple[int, str, str]]

COMMIT = "0123456789abcdef0123456789abcdef01234567"
SETUP = """from setuptools import find_packages, setup

setup(
    name="{0}",
    version="9.9.9",
    packages=find_packages(exclude=["test"]),
    data_files=[
        ("share/{0}", ["package.xml"]),
        ("share/ament_index/resource_index/packages", ["resource/{0}"]),
    ],
    entry_points={{"launch.frontend.launch_extension": ["{0} = {0}"], "console_scripts": ["play = {0}.play:main"]}},
)
raise SystemExit("setup.py was run")
"""
CMAKE = (
    "project({0})\nament_python_install_package({0})\ninstall(DIRECTORY cmake DESTINATION share/${{PROJECT_NAME}})\n"
)
XML = "<package><name>{}</name><version>3.4.11</version><license>Apache-2.0</license></package>"


def _package(name: str, setup: str = SETUP) -> dict[str, str]:
    return {
        f"{name}/package.xml": XML.format(name),
        f"{name}/setup.py": setup.format(name),
        f"{name}/setup.cfg": f"[install]\ninstall_scripts=$base/lib/{name}\n",
        f"{name}/resource/{name}": "",
        f"{name}/{name}/__init__.py": "",
        f"{name}/{name}/inner/grammar.lark": "start:",
        f"{name}/{name}/__pycache__/old.pyc": "",
        f"{name}/test/__init__.py": "",
    }


REPOSITORIES = {
    "ros2/launch": {**_package("launch"), **_package("launch_xml"), **_package("launch_yaml")},
    "ros2/launch_ros": _package("launch_ros"),
    "ros-navigation/navigation2": {
        "nav2_common/package.xml": XML.format("nav2_common"),
        "nav2_common/CMakeLists.txt": CMAKE.format("nav2_common"),
        "nav2_common/nav2_common/launch/__init__.py": "",
        "nav2_common/nav2_common/__init__.py": "",
        "nav2_common/cmake/nav2_package.cmake": "",
    },
}


@pytest.fixture(autouse=True)
def wheels(monkeypatch: pytest.MonkeyPatch) -> dict[str, ZipFile]:
    """Replace pip by a list of the wheels that it would install; no package of ROS is installed."""
    found: dict[str, ZipFile] = {}

    class Recorder(Installer):
        def install(self, *wheels: Path) -> None:
            found.update({one.name: ZipFile(one.rename(one.with_suffix(".installed"))) for one in wheels})

        def require(self, *requirements: str) -> None:
            raise AssertionError("the modules of the package index are installed")

    monkeypatch.setattr(Installer, "of_environment", lambda: Recorder("pip", (), (), (), ()))
    monkeypatch.setattr(launch_install, "find_spec", lambda name: None if name in LAUNCH_PACKAGES else object())
    return found


@pytest.fixture
def archives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Archives as GitHub serves them, in files."""
    for repository, files in REPOSITORIES.items():
        path = tmp_path / repository / "jazzy.zip"
        path.parent.mkdir(parents=True)
        with ZipFile(path, "w") as archive:
            for name, text in files.items():
                archive.writestr(f"{path.parent.name}-jazzy/{name}", text)
            archive.comment = COMMIT.encode()
    monkeypatch.setattr(launch_install, "ARCHIVE", f"{tmp_path.as_uri()}/{{repository}}/{{branch}}.zip")
    return tmp_path


def test_archives_of_the_distribution_become_wheels_and_each_origin_is_printed(
    run_here: RunHere, archives: Path, wheels: dict[str, ZipFile]
) -> None:
    code, out, err = run_here("launch", "--install", "--distro", "jazzy")
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        f"{name} 3.4.11: https://github.com/ros2/{repository}, branch jazzy, commit {COMMIT}"
        for name, repository in zip(LAUNCH_PACKAGES, ("launch", "launch", "launch", "launch_ros"), strict=True)
    ]
    wheel = wheels["launch_ros-3.4.11-py3-none-any.whl"]
    data = "launch_ros-3.4.11.data/data"
    assert {one for one in wheel.namelist() if not one.startswith("launch_ros-3.4.11.dist-info")} == {
        "launch_ros/__init__.py",
        "launch_ros/inner/grammar.lark",
        f"{data}/lib/launch_ros/play",
        f"{data}/share/ament_index/resource_index/packages/launch_ros",
        f"{data}/share/launch_ros/package.xml",
        f"{data}/{launch_install.ORIGINS}/launch_ros.json",
    }
    assert wheel.getinfo(f"{data}/lib/launch_ros/play").external_attr >> 16 & 0o111
    assert "launch_ros=launch_ros" in wheel.read("launch_ros-3.4.11.dist-info/entry_points.txt").decode().split()
    origin = json.loads(wheel.read(f"{data}/{launch_install.ORIGINS}/launch_ros.json"))
    assert {name: origin[name] for name in ("address", "branch", "commit", "version", "distribution")} == {
        "address": "https://github.com/ros2/launch_ros",
        "branch": "jazzy",
        "commit": COMMIT,
        "version": "3.4.11",
        "distribution": "jazzy",
    }
    assert len(origin["sha256"]) == 64


def test_named_packages_bring_missing_packages_of_launch(
    run_here: RunHere, archives: Path, wheels: dict[str, ZipFile], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run_here("launch", "--install", "nav2_common")[0] == 0
    assert [name.partition("-")[0] for name in wheels] == [*LAUNCH_PACKAGES, "nav2_common"]
    names = wheels["nav2_common-3.4.11-py3-none-any.whl"].namelist()
    assert "nav2_common/launch/__init__.py" in names
    assert "nav2_common-3.4.11.data/data/share/nav2_common/cmake/nav2_package.cmake" in names
    monkeypatch.setattr(launch_install, "find_spec", lambda name: object())
    wheels.clear()
    assert run_here("launch", "--install", "nav2_common")[0] == 0
    assert [name.partition("-")[0] for name in wheels] == ["nav2_common"]


@pytest.mark.slow
def test_folder_of_clones_replaces_the_network(run_here: RunHere, tmp_path: Path, wheels: dict[str, ZipFile]) -> None:
    for repository, files in REPOSITORIES.items():
        write(tmp_path / repository, files)
    git = ["git", "-C", str(tmp_path / "ros2/launch_ros"), "-c", "user.name=a", "-c", "user.email=a@example.org"]
    for words in (
        ["init", "--quiet"],
        ["remote", "add", "origin", "https://user:secret@example.org/launch_ros"],
        ["add", "."],
        ["commit", "--quiet", "-m", "x"],
    ):
        subprocess.run([*git, *words], check=True)
    commit = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout.strip()
    code, out, err = run_here("launch", "--install", "--launch-from", str(tmp_path))
    assert (code, err, len(wheels)) == (0, "", 4)
    folder = tmp_path / "ros2/launch_ros/launch_ros"
    assert out.splitlines()[-1] == f"launch_ros 3.4.11: https://example.org/launch_ros, {folder}, commit {commit}"
    assert out.splitlines()[0] == f"launch 3.4.11: {tmp_path / 'ros2/launch/launch'}, commit unknown"


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (
            ["--distro", "kilted"],
            r"file:.*/ros2/launch/kilted\.zip: cannot be downloaded: .*git clone --branch kilted ",
        ),
        (["nav2_comon"], r'no package "nav2_comon"; did you mean "nav2_common"\?; expected launch, '),
        (["--launch-from", "nowhere"], "nowhere: expected a folder with clones of https://github.com/ros2/launch and "),
        (["--launch-from", "."], r"\.: no package launch_ros; expected clones of https://github.com/ros2/launch_ros, "),
    ],
)
def test_failed_installation_prints_one_error_line_with_the_cure(
    words: list[str], text: str, run_here: RunHere, archives: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    write(tmp_path / "clones", REPOSITORIES["ros2/launch"])
    monkeypatch.chdir(tmp_path / "clones")
    code, out, err = run_here("launch", "--install", *words)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert re.match(f"error: {text}", err), err


def test_damaged_archive_prints_one_error_line(run_here: RunHere, archives: Path) -> None:
    (archives / "ros2/launch/jazzy.zip").write_bytes(b"<html>")
    code, _, err = run_here("launch", "--install")
    assert (code, err.count("\n")) == (1, 1)
    assert "/ros2/launch/jazzy.zip: expected a zip archive: " in err


def test_install_excludes_other_options_and_launch_requires_words(run_here: RunHere) -> None:
    code, _, err = run_here("launch", "--install", "--print")
    assert code == 2 and "--install takes names of packages, --launch-from and --distro; no other options" in err
    code, _, err = run_here("launch", "--debug")
    assert code == 2 and "expected (FILE | PACKAGE FILE) [NAME:=VALUE]..., or --install" in err


def test_note_about_missing_package_has_command_with_selected_distribution(monkeypatch: pytest.MonkeyPatch) -> None:
    assert install_note("launch_ros").endswith("github.com/ros2/launch_ros: rosidl-py launch --install")
    assert install_note("nav2_common").endswith("navigation2: rosidl-py launch --install nav2_common")
    assert install_note("numpy") == ""
