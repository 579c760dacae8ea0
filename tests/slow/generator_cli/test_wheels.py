"""Message packages as pip packages: wheels, and packages installed into and uninstalled from an environment."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

import rosidl_py_gen
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.compiler.frontend.bundled import BundledInterfaces
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.generator_cli import main
from rosidl_py_gen.wheels.build import PackageManifest, build_wheels

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


DEPENDENCIES = "numpy", "lark", "jinja2", "markupsafe", "click", "flit_core"


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    source(tmp_path / "src", "wheel_base_msgs", "0.5.0", "std_msgs", Wheel="std_msgs/Header header\nfloat64 speed\n")
    source(tmp_path / "src", "wheel_robot_msgs", "1.2.3", "wheel_base_msgs", Robot="wheel_base_msgs/Wheel[] wheels\n")
    return tmp_path / "src"


def site_of(python: Path) -> Path:
    return Path(printed(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment with pip, this package and its dependencies, and no message packages."""
    folder = tmp_path_factory.mktemp("clean")
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    return with_this_package(folder)


def with_this_package(environment: Path) -> Path:
    """Make this package and its dependencies importable in an environment, and return its Python."""
    (python,) = [path for path in (environment / "bin/python", environment / "Scripts/python.exe") if path.exists()]
    site = site_of(python)
    for name in DEPENDENCIES:
        spec = importlib.util.find_spec(name)
        assert spec is not None and spec.origin is not None, name
        module = Path(spec.origin).parent
        for path in (module, module.with_name(f"{name}.libs")):
            if path.exists():
                (site / path.name).symlink_to(path)
    (site / "here.pth").write_text(str(Path(rosidl_py_gen.__file__).parent.parent))
    return python


def printed(
    python: str | Path, *arguments: str | Path, status: int = 0, cwd: Path | None = None, **variables: str
) -> str:
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "AMENT_PREFIX_PATH")}
    environment |= variables
    done = subprocess.run([python, *arguments], capture_output=True, text=True, cwd=cwd, env=environment, check=False)
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout + done.stderr


GENERATOR = "-c", "from rosidl_py_gen.generator_cli import main; main()"


def test_each_package_becomes_wheel_with_metadata_of_its_manifest(workspace: Path, tmp_path: Path) -> None:
    search = SearchPath.scan([workspace])
    built = build_wheels(search, [], tmp_path / "dist")
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


def test_without_names_all_bundled_packages_become_wheels(tmp_path: Path, capsys: Any) -> None:
    main(["wheel", "--out", str(tmp_path)])
    written, names = capsys.readouterr().out.splitlines(), [*BundledInterfaces.of(Distribution.DEFAULT).packages]
    assert [Path(path).name.partition("-")[0] for path in written] == sorted(names)
    assert sorted(path.name for path in tmp_path.iterdir()) == [Path(path).name for path in written]


def test_installation_of_unknown_package_names_the_known_packages(capsys: Any) -> None:
    with pytest.raises(SystemExit):
        main(["--install", "--filter", "absent_msgs"])
    text = "error: absent_msgs: there is no package of this name; expected one of action_msgs, "
    assert capsys.readouterr().err.startswith(text)


def test_wheel_builds_are_reproducible(workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    search = SearchPath.scan([workspace])

    def made(folder: str) -> bytes:
        return build_wheels(search, ["wheel_base_msgs"], tmp_path / folder, dependencies=False)[0].path.read_bytes()

    first = made("a")
    os.utime(workspace / "wheel_base_msgs" / "msg" / "Wheel.msg", (1e9, 1e9))
    assert made("b") == first
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert (later := made("c")) != first and made("d") == later


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        (None, "no such file"),
        ("<package>", "not XML"),
        ("<package><version>one</version></package>", 'the version is "one"; pip needs one such as 1.2.3'),
        ("<package></package>", 'the version is ""'),
        ('<!DOCTYPE a [<!ENTITY b "c">]><package/>', "entities are refused"),
        ("<package>" + " " * (1 << 20), "more than 1048576 bytes"),
    ],
)
def test_invalid_manifests_for_wheels_are_reported(tmp_path: Path, text: str | None, printed: str) -> None:
    if text is not None:
        (tmp_path / "package.xml").write_text(text)
    with pytest.raises(DefinitionError, match=printed) as told:
        PackageManifest.read(tmp_path)
    assert "package.xml" in str(told.value)


def test_line_breaks_in_manifest_do_not_inject_metadata_headers(tmp_path: Path) -> None:
    package = source(tmp_path, "odd_msgs", "1.0.0", Odd="int32 x\n")
    manifest = package / "package.xml"
    manifest.write_text(manifest.read_text().replace("Apache-2.0", "MIT\nRequires-Dist: evil\n\nbody"))
    (built,) = build_wheels(SearchPath.scan([tmp_path]), ["odd_msgs"], tmp_path / "dist")
    with zipfile.ZipFile(built.path) as wheel:
        told = wheel.read("odd_msgs-1.0.0.dist-info/METADATA").decode()
    assert "\nRequires-Dist: evil" not in told and "License: MIT Requires-Dist: evil body\n" in told


@pytest.mark.needs("mypy")
def test_installed_wheels_are_importable_typed_and_found_as_dependencies(
    clean: Path, workspace: Path, tmp_path: Path
) -> None:
    printed(clean, *GENERATOR, "wheel", "--path", workspace, "--out", tmp_path / "dist")
    wheels = sorted((tmp_path / "dist").glob("*.whl"))
    printed(clean, "-m", "pip", "install", "--no-index", "--no-deps", *wheels)
    try:
        program = tmp_path / "program.py"
        program.write_text(
            "from wheel_base_msgs.msg import Wheel\nfrom wheel_robot_msgs.msg import Robot\n\n"
            "robot = Robot(wheels=[Wheel(speed=0.5)])\nspeed: float = Robot.decode(robot.encode()).wheels[0].speed\n"
            "print(speed)\n"
        )
        assert printed(clean, program, cwd=tmp_path) == "0.5\n"
        mypy = sys.executable, "-m", "mypy", "--strict", "--python-executable", clean, program
        assert "Success" in printed(*mypy, cwd=tmp_path)
        # Another team's package, made where only the wheels are.
        source(tmp_path / "other", "wheel_fleet_msgs", "2.0.0", Fleet="wheel_robot_msgs/Robot[] robots\n")
        made = printed(clean, *GENERATOR, "wheel", "--path", tmp_path / "other", "--out", tmp_path / "next")
        wheel, note = made.splitlines()
        assert Path(wheel).name == "wheel_fleet_msgs-2.0.0-py3-none-any.whl"
        assert note.startswith("required, but not made, because they are installed: ")
        assert "wheel-robot-msgs==1.2.3; name packages" in note
        listed = printed(clean, *GENERATOR, "--list")
        assert "site-packages" in next(line for line in listed.splitlines() if line.startswith("wheel_robot_msgs"))
        assert "clean0: wheel_robot_msgs" in printed(clean, *GENERATOR, "--uninstall", "--filter", "wheel_robot_msgs")
        assert "No module named" in printed(clean, "-c", "import wheel_robot_msgs", status=1)
    finally:
        printed(clean, *GENERATOR, "--uninstall")


def test_packages_are_installed_and_uninstalled(clean: Path, workspace: Path, tmp_path: Path) -> None:
    site = site_of(clean)
    before = sorted(path.relative_to(site) for path in site.rglob("*") if "__pycache__" not in path.parts)
    for others in ("std_msgs 0.1.0", "wheel_base_msgs 0.5.0"):  # the second run is an update
        done = printed(clean, *GENERATOR, "--path", workspace, "--filter", "wheel_robot_msgs", "--install")
        assert "wheel_robot_msgs 1.2.3" in done and others in done
    assert printed(clean, "-c", "from std_msgs.msg import String; print(String(data='a').data)", cwd=tmp_path) == "a\n"
    changed = site / "std_msgs" / "msg" / "_string.py"
    changed.write_text(changed.read_text() + "# mine\n")
    assert f"modified since the installation: {changed}" in printed(clean, *GENERATOR, "--uninstall", status=1)
    assert changed.exists()
    printed(clean, *GENERATOR, "--uninstall", "--force")
    assert sorted(path.relative_to(site) for path in site.rglob("*") if "__pycache__" not in path.parts) == before
    assert "uninstalled nothing" in printed(clean, *GENERATOR, "--uninstall")
    assert "std_msgs is not installed as a wheel" in printed(
        clean, *GENERATOR, "--uninstall", "--filter", "std_msgs", status=1
    )


@pytest.fixture(scope="module")
def uv() -> str:
    """Path of the program uv."""
    import uv

    found: str = uv.find_uv_bin()
    return found


@pytest.fixture(scope="module")
def clean_uv(uv: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment that uv made, as `clean`, but without pip."""
    folder = tmp_path_factory.mktemp("uv") / ".venv"
    printed(uv, "venv", "--offline", "--no-config", "--python", sys.executable, folder)
    python = with_this_package(folder)
    assert "No module named pip" in printed(python, "-m", "pip", status=1)
    return python


@pytest.mark.needs("uv")
def test_uv_installs_and_removes_packages_in_an_environment_without_pip(
    clean_uv: Path, uv: str, workspace: Path, tmp_path: Path
) -> None:
    site, on_path = site_of(clean_uv), os.pathsep.join([str(Path(uv).parent), os.environ["PATH"]])
    before = sorted(path.relative_to(site) for path in site.rglob("*") if "__pycache__" not in path.parts)
    for _ in range(2):  # the second run is an update
        done = printed(clean_uv, *GENERATOR, "--path", workspace, "--install", PATH=on_path, cwd=tmp_path)
        assert f"installed into {clean_uv.parent.parent}: " in done
        assert "std_msgs 0.1.0" in done and "wheel_robot_msgs 1.2.3" in done
    assert printed(clean_uv, "-c", "from wheel_robot_msgs.msg import Robot; print(len(Robot().wheels))") == "0\n"
    changed = site / "std_msgs" / "msg" / "_string.py"
    original = changed.read_text()
    changed.write_text(original + "# mine\n")
    assert "modified since" in printed(clean_uv, *GENERATOR, "--uninstall", PATH=on_path, status=1)
    printed(clean_uv, *GENERATOR, "--filter", "std_msgs", "--install", PATH=on_path)
    assert changed.read_text() == original
    assert "uninstalled from" in printed(clean_uv, *GENERATOR, "--uninstall", PATH=on_path)
    assert sorted(path.relative_to(site) for path in site.rglob("*") if "__pycache__" not in path.parts) == before


@pytest.mark.needs("uv")
def test_uv_of_the_environment_is_used_without_uv_on_path(clean_uv: Path, uv: str, tmp_path: Path) -> None:
    site = site_of(clean_uv)
    (site / "uv").mkdir()
    (site / "uv" / "__init__.py").touch()
    (site / "uv" / "__main__.py").write_text(
        f"import subprocess, sys\nprint('module', file=open({str(tmp_path / 'used')!r}, 'a'))\n"
        f"sys.exit(subprocess.call([{uv!r}, *sys.argv[1:]]))\n"
    )
    try:
        for action in ("--install", "--uninstall"):
            assert "turtlesim" in printed(clean_uv, *GENERATOR, "--filter", "turtlesim", action, PATH="/nowhere")
    finally:
        shutil.rmtree(site / "uv")
        printed(clean_uv, *GENERATOR, "--uninstall", PATH=str(Path(uv).parent))
    assert (tmp_path / "used").read_text() == "module\nmodule\n"


@pytest.mark.needs("uv")
def test_environment_without_pip_and_uv_is_an_error_with_commands(clean_uv: Path) -> None:
    text = printed(clean_uv, *GENERATOR, "--filter", "std_msgs", "--install", PATH="/nowhere", status=1)
    assert f"{clean_uv.parent.parent} has no pip, and there is no uv on PATH; expected one of them" in text
    assert f"`{clean_uv} -m ensurepip` adds pip" in text and "rosidl-py-gen wheel --out dist" in text


@pytest.mark.needs("uv")
def test_the_temporary_environment_of_uv_run_with_is_refused(uv: str, clean_uv: Path, tmp_path: Path) -> None:
    """`uv run --with` lays an environment over that of the command, and deletes it afterwards."""
    extra = tmp_path / "extra-1-py3-none-any.whl"
    with zipfile.ZipFile(extra, "w") as wheel:
        wheel.writestr("extra-1.dist-info/METADATA", "Metadata-Version: 2.1\nName: extra\nVersion: 1\n")
        wheel.writestr("extra-1.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr("extra-1.dist-info/RECORD", "")
    (tmp_path / "here").mkdir()
    text = printed(
        *(uv, "run", "--offline", "--no-config", "--no-project", "--python", clean_uv, "--with", extra),
        *("python", *GENERATOR, "--filter", "std_msgs", "--install"),
        cwd=tmp_path / "here",
        VIRTUAL_ENV=str(clean_uv.parent.parent),
        status=1,
    )
    assert "is temporary: `uv run --with` made it for one command; expected an environment of your own" in text


def test_externally_managed_python_is_an_error_suggesting_environment(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, tmp_path: Path
) -> None:
    """PEP 668: pip refuses to change it."""
    (tmp_path / "EXTERNALLY-MANAGED").write_text("[externally-managed]\nError=use apt\n")
    (tmp_path / "sitecustomize.py").write_text(
        "import sys, sysconfig\nsys.prefix = sys.base_prefix\npath = sysconfig.get_path\n"
        f"sysconfig.get_path = lambda name, *rest: {str(tmp_path)!r} if name == 'stdlib' else path(name, *rest)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.delenv("PIP_BREAK_SYSTEM_PACKAGES", raising=False)
    with pytest.raises(SystemExit):
        main(["--filter", "turtlesim", "--install"])
    assert "managed by the system (PEP 668), so pip refuses to install; use a virtual environment" in (
        capsys.readouterr().err
    )


def test_installation_runs_no_modules_of_current_folder(clean: Path, tmp_path: Path) -> None:
    for name in ("pip", "uv", "json", "sitecustomize"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a module of the current folder ran')\n")
    program = tmp_path / "bin" / "generator.py"
    program.parent.mkdir()
    program.write_text(GENERATOR[1])
    for action in ("--install", "--uninstall"):
        assert "turtlesim" in printed(clean, program, "--filter", "turtlesim", action, cwd=tmp_path)


def test_reinstallation_uses_definitions_of_selected_distribution(clean: Path, tmp_path: Path) -> None:
    shows = "from sensor_msgs.msg import Range; print('variance' in Range.__slots__)"
    install = *GENERATOR, "--filter", "sensor_msgs", "--install"
    try:
        for distro, has_variance in (("jazzy", True), ("humble", False), ("jazzy", True)):
            printed(clean, *install, cwd=tmp_path, ROS_DISTRO=distro)
            assert printed(clean, "-c", shows, cwd=tmp_path) == f"{has_variance}\n", distro
        # A definition of the user stays, unless its package is named.
        source(tmp_path / "src", "sensor_msgs", "9.0.0", "std_msgs", Range="int8 mine\n")
        source(tmp_path / "src", "my_msgs", "1.0.0", "sensor_msgs", Mine="sensor_msgs/Range range\n")
        printed(
            clean, *GENERATOR, "--path", tmp_path / "src", "--filter", "sensor_msgs:my_msgs", "--install", cwd=tmp_path
        )
        source(tmp_path / "other", "your_msgs", "1.0.0", "sensor_msgs", Yours="sensor_msgs/Range range\n")
        printed(clean, *GENERATOR, "--path", tmp_path / "other", "--filter", "your_msgs", "--install", cwd=tmp_path)
        assert printed(clean, "-c", "from sensor_msgs.msg import Range; print(Range().mine)", cwd=tmp_path) == "0\n"
    finally:
        printed(clean, *GENERATOR, "--uninstall", "--force")


def test_packages_not_installed_by_generator_are_not_overwritten(clean: Path, tmp_path: Path) -> None:
    site = site_of(clean)
    for name, words in (("std_msgs", "std_msgs is importable from"), ("rclpy", "rclpy is importable from")):
        (site / name).mkdir()
        (site / name / "__init__.py").write_text("# of ROS\n")
        try:
            assert words in printed(clean, *GENERATOR, "--filter", "std_msgs", "--install", status=1)
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
        (["wheel", "std_msg"], "there is no package of this name"),
    ],
)
def test_contradictory_options_are_refused(arguments: list[str], words: str, capsys: Any) -> None:
    with pytest.raises(SystemExit):
        main(arguments)
    assert words in "".join(capsys.readouterr())
