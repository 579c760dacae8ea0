"""Commands that promise to run no code of a workspace (SECURITY.md, docs/reference/settings.md) run none."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from support.folders import ROOT
from support.markdown_pages import rows
from support.program_processes import started

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.ros_cli.groups import COMMANDS

STUB = ROOT / "tests" / "support" / "launch_stub"
MARK = "import os\nwith open({mark!r}, 'a') as file:\n    file.write(__file__ + os.linesep)\n"
MANIFEST = """<package format="3"><name>{0}</name><version>1.0.0</version><description>d</description>
<maintainer email="me@example.org">me</maintainer><license>Apache-2.0</license>
<export><build_type>{1}</build_type></export></package>
"""
SETUP_PY = """
from setuptools import setup
names = [name for name in os.listdir(".") if os.path.isfile(name)]
rows = [("share/robot", names), ("share/robot/launch", ["launch/robot.launch.py"])]
setup(name="robot", version="1.0.0", packages=["robot"], data_files=rows,
      entry_points={"console_scripts": ["talker = robot.talker:main"]})
"""
LAUNCH_FILE = """
def generate_launch_description():
    from launch import LaunchDescription

    return LaunchDescription([])
"""
MODULES = ("sitecustomize", "usercustomize", "conftest", "json", "click", "yaml", "numpy", "pip", "uv", "rich", "mcap")
"""Modules of this environment or of Python, for which a file of the current folder could be taken."""
PACKAGES = ("rosidl_py_gen", "rclpy", "launch", "std_msgs", "my_msgs", "robot", "setuptools", "pytest")

GENERATOR: dict[str, str] = {
    "--list": "--path src --list",
    "--check": "--path src --filter my_msgs --check --out {out}/checked",
    "--out": "--path src --filter my_msgs --out {out}/generated",
    "check": "check --path src my_msgs",
    "wheel": "wheel --path src my_msgs --out {out}/dist",
    "diff": "diff src src",
    "interface": "interface --path src my_msgs/msg/Sample",
    "completion": "completion bash",
}
NO_CODE: dict[str, str] = {
    "prefix": "prefix src --out {out}/prefix",
    "run --list": "run --list",
    "run --list PACKAGE": "run --list robot",
    "run --check FILE": "run --check src/robot/robot/talker.py",
    "run --check PACKAGE": "run --check robot talker",
    "interface list": "interface list --path src",
    "interface show": "interface show --path src my_msgs/msg/Sample",
    "interface hash": "interface hash --path src my_msgs/msg/Sample",
    "bag info": "bag info {out}/drive.mcap",
    "bag convert": "bag convert {out}/drive.mcap {out}/drive_again.mcap",
    "bag reindex": "bag reindex {out}/drive.mcap",
    "bag migrate": "bag migrate {out}/drive.mcap -o {out}/drive_migrated --path src",
    "security": "security create_keystore {out}/keystore",
    "completion": "completion bash",
    "topic list": "topic list",
    "node list": "node list",
    "doctor": "doctor --discovery localhost --path src",
}
COMPLETED = ("run ", "run robot ", "launch ", "launch robot ", "test ", "prefix ", "topic echo ", "interface show ")
"""Command lines whose next word a shell completes."""


class MarkedWorkspace:
    """Folder in which every file of Python writes its path into the file `mark` when it runs."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.out, self.mark = folder / "ws", folder / "out", folder / "mark"
        self.out.mkdir()
        files = {f"{name}.py": "" for name in MODULES} | {f"{name}/__init__.py": "" for name in PACKAGES}
        robot = {
            "setup.py": SETUP_PY,
            "conftest.py": "",
            "sitecustomize.py": "",
            "robot/__init__.py": "",
            "robot/talker.py": "import rclpy\ndef main():\n    rclpy.init()\n",
            "launch/robot.launch.py": LAUNCH_FILE,
            "test/test_robot.py": "def test_robot():\n    pass\n",
            "build_backend.py": "",
        }
        files |= {f"src/robot/{name}": text for name, text in robot.items()}
        files |= {"src/my_msgs/setup.py": "", "src/my_msgs/my_msgs/__init__.py": "", "src/my_msgs/conftest.py": ""}
        for name, text in files.items():
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(MARK.format(mark=str(self.mark)) + text)
        (self.folder / "src/robot/package.xml").write_text(MANIFEST.format("robot", "ament_python"))
        (self.folder / "src/robot/setup.cfg").write_text("[develop]\nscript_dir=$base/lib/robot\n")
        (self.folder / "src/robot/pyproject.toml").write_text(
            "[build-system]\nrequires = []\nbuild-backend = 'build_backend'\nbackend-path = ['.']\n"
        )
        (self.folder / "src/my_msgs/package.xml").write_text(MANIFEST.format("my_msgs", "ament_cmake"))
        (self.folder / "src/my_msgs/msg").mkdir()
        (self.folder / "src/my_msgs/msg/Sample.msg").write_text("float64 value\n")
        (self.folder / "src/my_msgs/CMakeLists.txt").write_text(
            "project(my_msgs)\nfind_package(rosidl_default_generators REQUIRED)\n"
            f'execute_process(COMMAND touch "{self.mark}")\n'
            'rosidl_generate_interfaces(${PROJECT_NAME} "msg/Sample.msg")\n'
        )
        with BagWriter(self.out / "drive.mcap") as bag:
            bag.write("/words", get_message("std_msgs/msg/String")(data="hello"), 0)

    def ran(self, module: str, line: str, **settings: str) -> tuple[set[str], str]:
        """Call a command as its console script does; return the files that ran, without the folder, and its output."""
        self.mark.unlink(missing_ok=True)
        script = self.out / "command.py"  # a console script: its own folder is first on sys.path, not the current one
        script.write_text(f"from {module} import main\nmain()\n")
        words = line.format(out=self.out).split()
        settings = {"ROSIDL_PY_GEN_CACHE": str(self.out / "cache"), "HOME": str(self.out), **settings}
        done = started(sys.executable, script, *words, cwd=self.folder, PYTHONDONTWRITEBYTECODE="1", **settings)
        assert "Traceback" not in done.stderr and done.returncode in (0, 1), f"{line}: {done.stdout}{done.stderr}"
        found = self.mark.read_text().splitlines() if self.mark.exists() else []
        folder = os.path.realpath(self.folder)
        return {os.path.relpath(os.path.realpath(path), folder) for path in found}, done.stdout


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> MarkedWorkspace:
    return MarkedWorkspace(tmp_path_factory.mktemp("marked"))


@pytest.fixture(autouse=True)
def _only_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", "97")
    monkeypatch.delenv("PYTHONPATH", raising=False)


@pytest.mark.parametrize("line", GENERATOR.values(), ids=GENERATOR)
def test_the_generator_runs_no_code_of_a_workspace(workspace: MarkedWorkspace, line: str) -> None:
    ran, output = workspace.ran("rosidl_py_gen.generator_cli", line)
    assert ran == set() and output


@pytest.mark.parametrize("line", NO_CODE.values(), ids=NO_CODE)
def test_ros_commands_run_no_code_of_a_workspace(workspace: MarkedWorkspace, line: str) -> None:
    assert workspace.ran("rosidl_py_gen.ros_cli", line)[0] == set()


@pytest.mark.parametrize("line", COMPLETED)
def test_completion_runs_no_code_of_a_workspace(workspace: MarkedWorkspace, line: str) -> None:
    settings = {"_ROSIDL_PY_COMPLETE": "bash_complete", "COMP_WORDS": f"rosidl-py {line}", "COMP_CWORD": ""}
    settings["COMP_CWORD"] = str(len(settings["COMP_WORDS"].split()))
    ran, output = workspace.ran("rosidl_py_gen.ros_cli", "", **settings)
    assert ran == set()
    assert "robot" in output or line != "launch "


@pytest.mark.parametrize(
    ("line", "file"),
    [
        ("run robot talker", "src/robot/robot/talker.py"),
        ("launch robot robot.launch.py --launch-from {stub}", "src/robot/launch/robot.launch.py"),
        ("launch robot robot.launch.py --launch-from {stub} --show-args", "src/robot/launch/robot.launch.py"),
        ("launch robot robot.launch.py --launch-from {stub} --print", "src/robot/launch/robot.launch.py"),
        ("test robot", "src/robot/test/test_robot.py"),
    ],
)
def test_commands_that_start_a_workspace_run_its_code(workspace: MarkedWorkspace, line: str, file: str) -> None:
    for name in ("launch", "rclpy", "pytest", "numpy", "json", "yaml", "click", "rich", "conftest"):
        (workspace.folder / f"{name}.py").unlink(missing_ok=True)
    assert file in workspace.ran("rosidl_py_gen.ros_cli", line.replace("{stub}", str(STUB)))[0]


@pytest.mark.parametrize("page", ["SECURITY.md", "docs/reference/settings.md"])
def test_documentation_tables_name_commands_that_run_code_or_not(page: str) -> None:
    table = {row[0]: row[1] for row in rows(ROOT / page) if len(row) == 2}
    (runs,) = [words for words in table if "launch" in words and "test" in words and "run" in words]
    assert "--show-args" in runs + table[runs] and "--print" in runs + table[runs]
    others = " ".join(words for words in table if words is not runs)
    for word in ("rosidl-py prefix", "run --list", "run --check", "completion", "bag", "rosidl-py-gen"):
        assert word in others, word
    assert {"run", "launch", "test"} < set(COMMANDS)
