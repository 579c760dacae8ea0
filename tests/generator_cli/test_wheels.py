"""Message packages as pip packages: wheels, and packages installed into an environment and taken back."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.generator_cli import main
from rosidl_py_gen.wheels.build import build, read_manifest, selected_packages

MANIFEST = """<package format="3">
  <name>{name}</name><version>{version}</version><description>Messages
  of a robot</description><maintainer email="me@example.org">Me</maintainer><license>Apache-2.0</license>
  <url type="repository">https://example.org/robot</url>{depends}
</package>
"""


def source(folder: Path, name: str, version: str, *depends: str, **messages: str) -> Path:
    package = folder / name
    (package / "msg").mkdir(parents=True)
    lines = "".join(f"<depend>{one}</depend>" for one in depends)
    (package / "package.xml").write_text(MANIFEST.format(name=name, version=version, depends=lines))
    for message, text in messages.items():
        (package / "msg" / f"{message}.msg").write_text(text)
    return package


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    source(tmp_path / "src", "wheel_base_msgs", "0.5.0", "std_msgs", Wheel="std_msgs/Header header\nfloat64 speed\n")
    source(tmp_path / "src", "wheel_robot_msgs", "1.2.3", "wheel_base_msgs", Robot="wheel_base_msgs/Wheel[] wheels\n")
    return tmp_path / "src"


def site_of(python: Path) -> Path:
    return Path(said(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of an environment with pip, this package and what it needs, and no message packages."""
    folder = tmp_path_factory.mktemp("clean")
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    (bin_,) = [path for path in (folder / "bin" / "python", folder / "Scripts" / "python.exe") if path.exists()]
    site = site_of(bin_)
    ours = Path(next(path for path in sys.path if path.endswith("site-packages")))
    for name in ("numpy", "numpy.libs", "lark", "jinja2", "markupsafe", "click", "flit_core"):
        if (ours / name).exists():
            (site / name).symlink_to(ours / name)
    import rosidl_py_gen

    (site / "here.pth").write_text(str(Path(rosidl_py_gen.__file__).parent.parent))
    return bin_


def said(python: str | Path, *arguments: str | Path, status: int = 0, cwd: Path | None = None) -> str:
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "AMENT_PREFIX_PATH")}
    done = subprocess.run([python, *arguments], capture_output=True, text=True, cwd=cwd, env=environment, check=False)
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout + done.stderr


GENERATOR = "-c", "from rosidl_py_gen.generator_cli import main; main()"


def test_each_package_becomes_a_wheel_with_what_its_manifest_says(workspace: Path, tmp_path: Path) -> None:
    search = scan_search_path([workspace])
    built = build(search, selected_packages(search, []), tmp_path / "dist")
    names = [one.path.name for one in built]
    assert names == [
        "builtin_interfaces-0.1.0-py3-none-any.whl",
        "std_msgs-0.1.0-py3-none-any.whl",
        "wheel_base_msgs-0.5.0-py3-none-any.whl",
        "wheel_robot_msgs-1.2.3-py3-none-any.whl",
    ]
    with zipfile.ZipFile(built[-1].path) as wheel:
        assert wheel.testzip() is None
        files = set(wheel.namelist())
        assert {"wheel_robot_msgs/py.typed", "wheel_robot_msgs/package.xml", "wheel_robot_msgs/msg/Robot.msg"} <= files
        told = wheel.read("wheel_robot_msgs-1.2.3.dist-info/METADATA").decode()
    for line in (
        "Name: wheel-robot-msgs",
        "Version: 1.2.3",
        "Summary: Messages of a robot",
        "Maintainer-email: Me <me@example.org>",
        "License: Apache-2.0",
        "Project-URL: repository, https://example.org/robot",
        "Requires-Dist: wheel-base-msgs==0.5.0",
        "Requires-Dist: std-msgs==0.1.0",
    ):
        assert f"{line}\n" in told
    assert "Requires-Dist: rosidl-py-gen>=" in told


def test_a_wheel_has_the_same_bytes_every_time(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    search = scan_search_path([workspace])

    def made(folder: str) -> bytes:
        return build(search, ["wheel_base_msgs"], tmp_path / folder, dependencies=False)[0].path.read_bytes()

    first = made("a")
    os.utime(workspace / "wheel_base_msgs" / "msg" / "Wheel.msg", (1e9, 1e9))
    assert made("b") == first
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert (later := made("c")) != first and made("d") == later


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "no such file"),
        ("<package>", "not XML"),
        ("<package><version>one</version></package>", 'the version is "one"; pip needs one such as 1.2.3'),
        ("<package></package>", 'the version is ""'),
        ('<!DOCTYPE a [<!ENTITY b "c">]><package/>', "entities are refused"),
        ("<package>" + " " * (1 << 20), "more than 1048576 bytes"),
    ],
)
def test_a_manifest_that_makes_no_wheel_is_told(tmp_path: Path, text: str | None, said: str) -> None:
    if text is not None:
        (tmp_path / "package.xml").write_text(text)
    with pytest.raises(DefinitionError, match=said) as told:
        read_manifest(tmp_path)
    assert "package.xml" in str(told.value)


def test_lines_of_a_manifest_cannot_make_headers(tmp_path: Path) -> None:
    package = source(tmp_path, "odd_msgs", "1.0.0", Odd="int32 x\n")
    manifest = package / "package.xml"
    manifest.write_text(manifest.read_text().replace("Apache-2.0", "MIT\nRequires-Dist: evil\n\nbody"))
    (built,) = build(scan_search_path([tmp_path]), ["odd_msgs"], tmp_path / "dist")
    with zipfile.ZipFile(built.path) as wheel:
        told = wheel.read("odd_msgs-1.0.0.dist-info/METADATA").decode()
    assert "\nRequires-Dist: evil" not in told and "License: MIT Requires-Dist: evil body\n" in told


@pytest.mark.needs("mypy")
def test_wheels_are_installed_used_typed_and_found_by_the_next_package(
    clean: Path, workspace: Path, tmp_path: Path
) -> None:
    said(clean, *GENERATOR, "wheel", "--path", workspace, "--out", tmp_path / "dist")
    wheels = sorted((tmp_path / "dist").glob("*.whl"))
    said(clean, "-m", "pip", "install", "--no-index", "--no-deps", *wheels)
    try:
        program = tmp_path / "program.py"
        program.write_text(
            "from wheel_base_msgs.msg import Wheel\nfrom wheel_robot_msgs.msg import Robot\n\n"
            "robot = Robot(wheels=[Wheel(speed=0.5)])\nspeed: float = Robot.decode(robot.encode()).wheels[0].speed\n"
            "print(speed)\n"
        )
        assert said(clean, program, cwd=tmp_path) == "0.5\n"
        mypy = sys.executable, "-m", "mypy", "--strict", "--python-executable", clean, program
        assert "Success" in said(*mypy, cwd=tmp_path)
        # Another team's package, made where only the wheels are.
        source(tmp_path / "other", "wheel_fleet_msgs", "2.0.0", Fleet="wheel_robot_msgs/Robot[] robots\n")
        made = said(clean, *GENERATOR, "wheel", "--path", tmp_path / "other", "--out", tmp_path / "next")
        wheel, note = made.splitlines()
        assert Path(wheel).name == "wheel_fleet_msgs-2.0.0-py3-none-any.whl"
        assert note.startswith("required, but not made, because they are installed: ")
        assert "wheel-robot-msgs==1.2.3; name packages" in note
        listed = said(clean, *GENERATOR, "--list")
        assert "site-packages" in next(line for line in listed.splitlines() if line.startswith("wheel_robot_msgs"))
        assert "uninstalled wheel_robot_msgs" in said(clean, *GENERATOR, "--uninstall", "--filter", "wheel_robot_msgs")
        assert "No module named" in said(clean, "-c", "import wheel_robot_msgs", status=1)
    finally:
        said(clean, *GENERATOR, "--uninstall")


def test_packages_are_installed_and_taken_back(clean: Path, workspace: Path, tmp_path: Path) -> None:
    site = site_of(clean)
    before = sorted(path.relative_to(site) for path in site.rglob("*") if "__pycache__" not in path.parts)
    for others in ("std_msgs 0.1.0", "wheel_base_msgs 0.5.0"):  # the second run is an update
        done = said(clean, *GENERATOR, "--path", workspace, "--filter", "wheel_robot_msgs", "--install")
        assert "wheel_robot_msgs 1.2.3" in done and others in done
    assert said(clean, "-c", "from std_msgs.msg import String; print(String(data='a').data)", cwd=tmp_path) == "a\n"
    changed = site / "std_msgs" / "msg" / "_string.py"
    changed.write_text(changed.read_text() + "# mine\n")
    assert f"modified since the installation: {changed}" in said(clean, *GENERATOR, "--uninstall", status=1)
    assert changed.exists()
    said(clean, *GENERATOR, "--uninstall", "--force")
    assert sorted(path.relative_to(site) for path in site.rglob("*") if "__pycache__" not in path.parts) == before
    assert "uninstalled nothing" in said(clean, *GENERATOR, "--uninstall")
    assert "std_msgs is not installed as a wheel" in said(
        clean, *GENERATOR, "--uninstall", "--filter", "std_msgs", status=1
    )


def test_packages_of_others_are_left_alone(clean: Path, tmp_path: Path) -> None:
    site = site_of(clean)
    for name, words in (("std_msgs", "std_msgs is importable from"), ("rclpy", "rclpy is importable from")):
        (site / name).mkdir()
        (site / name / "__init__.py").write_text("# of ROS\n")
        try:
            assert words in said(clean, *GENERATOR, "--filter", "std_msgs", "--install", status=1)
            assert (site / name / "__init__.py").read_text() == "# of ROS\n"
        finally:
            (site / name / "__init__.py").unlink()
            (site / name).rmdir()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--install", "--filter", "std_msgs", "--out", "x"], "--out and --install do not go together"),
        (["--uninstall", "--check"], "--check and --uninstall do not go together"),
        (["--force", "--filter", "std_msgs"], "--force belongs to --install and --uninstall"),
        (["wheel"], "name packages, such as std_msgs, or give the folder of your own"),
        (["wheel", "std_msg"], "there is no package of this name"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments: list[str], words: str, capsys: Any) -> None:
    with pytest.raises(SystemExit):
        main(arguments)
    assert words in "".join(capsys.readouterr())
