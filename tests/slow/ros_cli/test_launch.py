"""``rosidl-py launch`` with a stub of launch and launch_ros (`support/launch_stub/README`)."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from support.folders import ROOT, TESTS
from support.interface_packages import write
from support.program_processes import PACKAGE_XML, started
from support.waiting import wait_until

pytestmark = [
    pytest.mark.real_time("launch files start processes"),
    pytest.mark.skipif(os.name == "nt", reason="a prefix needs links and executable scripts"),
    pytest.mark.skipif(find_spec("launch") is not None, reason="launch is installed, and precedes the stub"),
]

LAUNCH = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "launch"]
STUB = TESTS / "support" / "launch_stub"
FROM = ["--launch-from", str(STUB)]
_END_S = 30.0
"""Maximum time between a signal and the end of all processes, of which one would sleep for 99 s."""

TALKER = """
import os, subprocess, sys
import rclpy
from std_msgs.msg import String

def talker():
    rclpy.init()
    node = rclpy.create_node("talker")
    publisher = node.create_publisher(String, "chatter", 10)
    node.create_timer(0.1, lambda: publisher.publish(String(data=node.get_name())))
    print(node.get_name(), "runs", flush=True)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        print(node.get_name(), "was stopped", flush=True)

def plain():
    with rclpy.init():
        node = rclpy.create_node("talker")
        timer = node.create_timer(0.01, lambda: (timer.cancel(), print("plain runs", os.getpid(), flush=True)))
        rclpy.spin(node)

def leave():
    code = "from signal import *; import time; signal(SIGINT, SIG_IGN); print('child', flush=True); time.sleep(99)"
    subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
    talker()
"""
SETUP_PY = """
from glob import glob
from setuptools import setup
setup(
    name="robot",
    packages=["robot"],
    data_files=[
        ("share/robot", ["package.xml"]),
        ("share/robot/launch", glob("launch/*.py")),
        ("share/robot/a", ["a/twice.launch.py"]),
        ("share/robot/b", ["b/twice.launch.py"]),
    ],
    entry_points={"console_scripts": [
        "talker = robot.talker:talker", "leave = robot.talker:leave", "plain = robot.talker:plain"
    ]},
)
"""
SETUP_CFG = "[develop]\nscript_dir=$base/lib/robot\n[install]\ninstall_scripts=$base/lib/robot\n"
HEAD = """
import os
from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription, OpaqueFunction
from launch.core import LaunchConfiguration
from launch.launch_description_sources import AnyLaunchDescriptionSource, PythonLaunchDescriptionSource
from launch_ros.actions import ComposableNodeContainer, FindPackageShare, Listener, LoadComposableNodes, Node

"""


def _file(*entities: str, before: str = "") -> str:
    return f"{HEAD}def generate_launch_description():\n{before}    return LaunchDescription([{', '.join(entities)}])\n"


FILES = {
    "robot.launch.py": _file(
        "DeclareLaunchArgument('name', 'walle', 'name of the node')",
        "OpaqueFunction(lambda c: [Node(package='robot', executable='talker', name=c.launch_configurations['name'])])",
        "Listener()",
    ),
    "leave.launch.py": _file("Node(package='robot', executable='leave')"),
    "plain.launch.py": _file("Node(package='robot', executable='plain')"),
    "missing.launch.py": _file(
        "Node(package='rviz2', executable='rviz2', arguments=['-d', os.path.join(folder, 'x.rviz')])",
        "Node(package='rviz2', executable='rviz2')",
        "Node(package='robot', executable='talkr')",
        "Node(package='cpp', executable='planner')",
        "ComposableNodeContainer(package='rclcpp_components', executable='component_container', name='box')",
        "LoadComposableNodes('box')",
        "Node(package='rclcpp_components', executable='component_container_isolated', name='nav')",
        "LoadComposableNodes('nav')",
        "IncludeLaunchDescription(PythonLaunchDescriptionSource(os.path.join(folder, 'launch', 'world.launch.py')))",
        "ExecuteProcess(cmd=['gzserver', 'x'])",
        "ExecuteProcess(cmd=['echo', 'echo runs'])",
        before="    folder = get_package_share_directory('gazebo_ros')\n",
    ),
    "one_missing.launch.py": _file(
        "ExecuteProcess(cmd=['echo', 'first'])", "Node(package='rviz2', executable='rviz2')"
    ),
    "argument.launch.py": _file(
        "Node(package='robot', executable='talker', arguments=[FindPackageShare('nav2_bringup')])"
    ),
    "messages.launch.py": "from px4_msgs.msg import VehicleStatus\n",
    "syntax.launch.py": "def generate_launch_description(:\n    pass\n",
    "raises.launch.py": "import os\n\ndef generate_launch_description():\n    return os.environ['MODEL_OF_NOBODY']\n",
    "imports.launch.py": "import nav2_common.launch\n",
    "late.launch.py": _file("OpaqueFunction(lambda context: {}['key'])"),
    "later.launch.py": _file(
        "OpaqueFunction(later)",
        before="    later = lambda context: [\n        Node(package='robot',\n executable='talkr')\n    ]\n",
    ),
    "include.launch.py": _file("IncludeLaunchDescription(AnyLaunchDescriptionSource('src/robot/xml.launch'))"),
    "ros2.launch.py": _file("ExecuteProcess(cmd=['ros2', 'pkg', 'prefix', 'robot'])"),
    "required.launch.py": _file("DeclareLaunchArgument('model', description='URDF file')"),
}
NODE = '  <node pkg="robot"\n    exec="talkr"/><!-- talkr -->\n'
FRONTEND_FILES = {
    "xml.launch": f"<launch>\n{NODE}</launch>\n",
    "twice.launch": f"<launch>\n{NODE}{NODE}</launch>\n",
    "yaml.launch": "launch:\n- node:\n    pkg: robot\n    exec: 'talkr'\n",
}


@pytest.fixture(scope="module", autouse=True)
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ws")
    files = {f"src/robot/launch/{name}": text for name, text in FILES.items()}
    files |= {f"src/robot/{place}/twice.launch.py": FILES["robot.launch.py"] for place in "ab"}
    files |= {f"src/robot/{name}": text for name, text in FRONTEND_FILES.items()}
    files["src/robot/package.xml"] = PACKAGE_XML.format("robot")
    files |= {"src/robot/setup.py": SETUP_PY, "src/robot/setup.cfg": SETUP_CFG}
    files |= {"src/robot/robot/__init__.py": "", "src/robot/robot/talker.py": TALKER}
    files["src/cpp/package.xml"] = PACKAGE_XML.format("cpp")
    files["src/cpp/CMakeLists.txt"] = (
        "project(cpp)\nadd_executable(planner p.cpp)\ninstall(TARGETS planner DESTINATION lib/${PROJECT_NAME})\n"
    )
    write(folder, files)
    return folder


@pytest.fixture(autouse=True)
def _settings(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))


def _launch(
    workspace: Path, *words: str, stub: bool = True, path: str = os.defpath
) -> subprocess.CompletedProcess[str]:
    return started(*LAUNCH, *words, *(FROM if stub else ()), cwd=workspace, LAUNCH_STUB_LOOKUP="1", PATH=path)


def _children() -> set[str]:
    """Return the command lines of processes with this workspace or stub in them."""
    found = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
    return {line for line in found.splitlines() if "time.sleep(99)" in line}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("file", ["robot.launch.py", "leave.launch.py"])
def test_a_signal_ends_all_processes(workspace: Path, tmp_path: Path, number: signal.Signals, file: str) -> None:
    output = tmp_path / "output"
    words = ["robot", file, *(["name:=eve"] if file == "robot.launch.py" else [])]
    expected = ["eve runs", "launch heard eve"] if file == "robot.launch.py" else ["talker runs", "child"]
    with output.open("w") as opened:
        process = subprocess.Popen(
            [*LAUNCH, *words, *FROM], cwd=workspace, stdin=subprocess.DEVNULL, stdout=opened, stderr=opened, text=True
        )
        end = time.monotonic() + 60
        while not all(one in output.read_text() for one in expected) and time.monotonic() < end:
            assert process.poll() is None, output.read_text()
            time.sleep(0.05)
        sent = time.monotonic()
        process.send_signal(number)
        code = process.wait(60)
    text = output.read_text()
    assert time.monotonic() - sent < _END_S, text
    assert code == 0, text
    assert all(one in text for one in expected), text
    assert f"{expected[0].split()[0]} was stopped" in text
    assert ("have left behind: python" in text) == (file == "leave.launch.py")
    assert not _children()
    if file == "robot.launch.py":
        assert "argv ['name:=eve'] noninteractive True debug False" in text


def _sleeps(process: str) -> bool:
    return subprocess.run(["ps", "-o", "stat=", "-p", process], capture_output=True, text=True).stdout.startswith("S")


def test_ctrl_c_prints_no_frames_inside_rclpy(workspace: Path) -> None:
    command = [*LAUNCH, "robot", "plain.launch.py", *FROM]
    with subprocess.Popen(
        command, cwd=workspace, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        while "plain runs" not in (line := process.stdout.readline()):
            assert line
        node = line.split()[-1]
        wait_until(lambda: _sleeps(node))  # it has printed inside a callback, and waits in spin
        process.send_signal(signal.SIGINT)
        text = process.stdout.read()
    assert "rclpy.spin(node)" in text and "\nKeyboardInterrupt\n" in text
    assert text.count("  File ") == 3, text


def test_missing_parts_are_skipped_and_reported_once(workspace: Path) -> None:
    done = _launch(workspace, "robot", "missing.launch.py", "--missing", "skip")
    assert done.returncode == 0, done.stderr
    assert "echo runs" in done.stdout
    assert [line for line in done.stderr.splitlines() if line.startswith("missing")] == [
        "missing, skipped: package gazebo_ros",
        "missing, skipped: executable rviz2 of rviz2: no such package (Node)",
        'missing, skipped: executable talkr of robot; did you mean "talker"?; it has: leave, plain, talker (Node)',
        "missing, skipped: executable planner of cpp: its package has C++ code, which is not built (Node)",
        "missing, skipped: executable component_container of rclcpp_components: no such package "
        "(ComposableNodeContainer)",
        "missing, skipped: nodes of the container box",
        "missing, skipped: executable component_container_isolated of rclcpp_components: no such package (Node)",
        "missing, skipped: nodes of the container nav",
        "missing, skipped: launch file gazebo_ros/launch/world.launch.py (IncludeLaunchDescription)",
        "missing, skipped: command gzserver (ExecuteProcess)",
    ]


CURE = "install it, or pass the folder of its package with --path, or start the rest with --missing skip"
LAUNCH_DIR = "src/robot/launch"
ERRORS = {
    ("robot", "one_missing.launch.py"): f"{LAUNCH_DIR}/one_missing.launch.py:11: missing executable rviz2 of rviz2: no "
    f"such package; {CURE}",
    ("robot", "later.launch.py"): f"{LAUNCH_DIR}/later.launch.py:12: missing executable talkr of robot; did you mean ",
    ("robot", "argument.launch.py"): f"{LAUNCH_DIR}/argument.launch.py:11: missing package nav2_bringup; {CURE}",
    ("src/robot/xml.launch",): "src/robot/xml.launch:3: missing executable talkr of robot; did you mean ",
    ("src/robot/yaml.launch",): "src/robot/yaml.launch:4: missing executable talkr of robot; did you mean ",
    ("src/robot/twice.launch",): "src/robot/twice.launch: missing executable talkr of robot; did you mean ",
    ("robot", "include.launch.py"): "src/robot/xml.launch:3: missing executable talkr of robot; did you mean ",
    ("robot", "missing.launch.py"): f"{LAUNCH_DIR}/missing.launch.py:11: missing package gazebo_ros; {CURE}",
    ("robot", "imports.launch.py"): f"{LAUNCH_DIR}/imports.launch.py:1: missing Python module nav2_common; "
    "nav2_common is in https://github.com/ros-navigation/navigation2: rosidl-py launch --install nav2_common, or ",
    (
        "robot",
        "messages.launch.py",
    ): f"{LAUNCH_DIR}/messages.launch.py:1: missing Python module px4_msgs; px4_msgs is in "
    "https://github.com/PX4/px4_msgs, branch main: git clone ",
    ("robot", "syntax.launch.py"): f"{LAUNCH_DIR}/syntax.launch.py:1: SyntaxError: ",
    ("robot", "raises.launch.py"): f"{LAUNCH_DIR}/raises.launch.py:4: KeyError: 'MODEL_OF_NOBODY'",
    ("robot", "late.launch.py"): f"{LAUNCH_DIR}/late.launch.py:11: KeyError: 'key'",
    ("robot", "required.launch.py"): f"{LAUNCH_DIR}/required.launch.py: the argument model has no value: URDF file; "
    "pass model:=VALUE (--show-args prints all arguments)",
    ("robot", "twice.launch.py"): "robot has several files twice.launch.py: a/twice.launch.py, b/twice.launch.py; pass "
    "one of these paths instead of the name",
    ("robot", "robo.launch.py"): 'has no file "robo.launch.py"; did you mean "robot.launch.py"?; its launch files: ',
    ("robot",): "expected a launch file of robot; its launch files: a/twice.launch.py, b/twice.launch.py, launch/",
    ("robo", "robot.launch.py"): 'no file and no package "robo"; did you mean "robot"?; searched the workspace, --path '
    "and AMENT_PREFIX_PATH",
    ("nowhere/x.launch.py",): "nowhere/x.launch.py: expected a launch file, no such file",
    ("nowhere/x.launch.py", "a:=1", "b"): "nowhere/x.launch.py: expected a launch file, no such file",
    ("robo", "a:=1", "b"): 'no file and no package "robo"; did you mean "robot"?; searched the workspace',
    ("src/robot/launch/",): "src/robot/launch/: expected a launch file, it is a folder",
    ("robot", "robot.launch.py", "name=x"): 'error: rosidl-py launch: expected NAME:=VALUE, found "name=x"\n',
    ("robot", "robot.launch.py", "--launch-prefix-filter", "x"): "--launch-prefix-filter requires --launch-prefix",
}


@pytest.mark.parametrize("words", ERRORS, ids=" ".join)
def test_launch_errors_name_location_and_fix(workspace: Path, words: tuple[str, ...]) -> None:
    done = _launch(workspace, *words)
    assert ERRORS[words] in done.stderr
    assert done.returncode == (2 if "hint: expected `rosidl-py launch " in done.stderr else 1)
    assert "Traceback" not in done.stderr


ELEMENTS = {
    "[LogInfo(msg='a')]": "element 1 of LaunchDescription is a value of type list; expected actions and "
    "LaunchDescriptions; * in front of the list unpacks it",
    "None": "element 1 of LaunchDescription is None; expected actions and LaunchDescriptions",
    "(1,)": "element 1 of LaunchDescription is a value of type tuple; ",
    "'text'": "element 1 of LaunchDescription is a value of type str, 'text'; ",
    "LaunchDescription([3])": "element 1 of LaunchDescription is a value of type int, 3; ",
    "TimerAction(period=1.0, actions=[None])": "an element of TimerAction is None; ",
    "OpaqueFunction(function=lambda context: [None])": "TypeError: element 1 of OpaqueFunction is None; ",
    "OpaqueFunction(function=lambda context: OpaqueFunction(function=print))": "TypeError: OpaqueFunction returned a "
    "value of type OpaqueFunction; expected actions and LaunchDescriptions in a list",
    "OpaqueFunction(function=lambda context: LaunchDescription([None]))": "TypeError: OpaqueFunction returned a value "
    "of type LaunchDescription; ",
    "OpaqueFunction(function=lambda context: [LaunchDescription([None])])": "TypeError: element 1 of Launch",
}
RETURNED = {
    "None": "generate_launch_description returned None; expected a LaunchDescription",
    "[OpaqueFunction(function=print)]": "generate_launch_description returned a value of type list; ",
    "OpaqueFunction(function=print)": "generate_launch_description returned a value of type OpaqueFunction; ",
}


def test_ros2_command_in_launch_file_runs_rosidl_py_unless_on_path(workspace: Path, tmp_path: Path) -> None:
    done = _launch(workspace, "robot", "ros2.launch.py")
    assert done.returncode == 0 and "[ros2]: process has ended with 0" in done.stdout, done.stderr
    assert any(os.path.isdir(os.path.join(line, "share/robot")) for line in done.stdout.splitlines())
    (tmp_path / "ros2").write_text("#!/bin/sh\necho the ros2 of ROS\n")
    (tmp_path / "ros2").chmod(0o755)
    done = _launch(workspace, "robot", "ros2.launch.py", path=f"{os.defpath}{os.pathsep}{tmp_path}")
    assert "the ros2 of ROS" in done.stdout


def wrong_description(folder: Path, returned: str, *options: str) -> subprocess.CompletedProcess[str]:
    head = HEAD.replace("import DeclareLaunchArgument", "import TimerAction, DeclareLaunchArgument")
    text = f"LogInfo = DeclareLaunchArgument\ndef generate_launch_description():\n    return {returned}\n"
    (folder / "wrong.launch.py").write_text(head + text.replace("msg=", "name="))
    return _launch(folder, "wrong.launch.py", *options)


WRONG = RETURNED | {f"LaunchDescription([{element}])": text for element, text in ELEMENTS.items()}


@pytest.mark.parametrize("returned", WRONG)
def test_wrong_element_of_a_description_is_named_in_one_line(tmp_path: Path, returned: str) -> None:
    done = wrong_description(tmp_path, returned)
    error, *more = (line for line in done.stderr.splitlines() if not line.startswith("[ERROR] [launch]"))
    assert error.startswith("error: wrong.launch.py") and WRONG[returned] in error and not more
    assert done.returncode == 1


@pytest.mark.parametrize("option", ["--show-args", "--print"])
def test_wrong_element_of_a_printed_description_is_one_line(tmp_path: Path, option: str) -> None:
    done = wrong_description(tmp_path, "LaunchDescription([None])", option)
    text = "element 1 of LaunchDescription is None; expected actions and LaunchDescriptions"
    assert done.returncode == 1 and re.fullmatch(rf"error: wrong\.launch\.py:\d+: {text}\n", done.stderr)


def test_launch_file_that_includes_itself_ends_with_one_line_of_error(tmp_path: Path) -> None:
    text = """
from launch.launch_description_sources import PythonLaunchDescriptionSource
def generate_launch_description():
    return LaunchDescription([IncludeLaunchDescription(PythonLaunchDescriptionSource(__file__))])
"""
    (tmp_path / "again.launch.py").write_text(
        HEAD.replace("import Declare", "import IncludeLaunchDescription, Declare") + text
    )
    done = _launch(tmp_path, "again.launch.py")
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("error: again.launch.py: it includes itself") and "OpaqueFunction" in done.stderr


def test_package_name_that_ament_refuses_is_one_line(tmp_path: Path) -> None:
    write(tmp_path, {"src/p/package.xml": PACKAGE_XML.format("p"), "src/p/launch/x.launch.py": "x = 1"})
    done = _launch(tmp_path, "p", "x.launch.py")
    rule = "expected 2 to 201 ASCII letters, digits, _ and -, of which the first is a letter or digit"
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f'error: "p" is not a file, nor the name of a package; {rule}\n'


def test_launch_file_is_selected_by_package_or_path_with_its_arguments(workspace: Path) -> None:
    """An unknown argument causes a warning, and a path below the share folder selects one of several files."""
    for words in (["robot", "a/twice.launch.py"], ["src/robot/launch/robot.launch.py"], ["robot", "robot.launch.py"]):
        done = _launch(workspace, *words, "--show-args")
        lines = ["", "    'name':", "        name of the node", "        (default: 'walle')"]
        assert done.stdout.splitlines() == ["Arguments (pass arguments as '<name>:=<value>'):", *lines]
        assert (done.returncode, done.stderr) == (0, "")
    done = _launch(workspace, "robot", "robot.launch.py", "--print-description")
    assert done.stdout.splitlines()[1:] == ["├── DeclareLaunchArgument", "├── OpaqueFunction", "├── Listener"]
    done = _launch(workspace, "robot", "one_missing.launch.py", "--missing", "skip", "nam:=x", "--launch-prefix", "env")
    assert "argv ['nam:=x', 'launch-prefix:=env'] noninteractive True debug False" in done.stdout
    warning = f"warning: {LAUNCH_DIR}/one_missing.launch.py declares no argument nam; it is set nevertheless"
    assert done.stderr.count(warning) == 1
    assert "launch-prefix" not in done.stderr


@pytest.mark.parametrize("distro", [(), ("--distro", "humble")])
def test_missing_launch_package_error_has_command_that_installs_it(workspace: Path, distro: tuple[str, ...]) -> None:
    done = _launch(workspace, "robot", "robot.launch.py", *distro, stub=False)
    assert done.returncode == 1
    command = " ".join(("rosidl-py launch --install", *distro))
    assert done.stderr == f"error: the package launch of ROS is neither installed nor below --path; run: {command}\n"


def test_launch_file_runs_with_packages_that_the_command_has_installed(workspace: Path, tmp_path: Path) -> None:
    """pip installs the stub of launch, and packages launch_xml and launch_yaml, into a new environment."""
    clones = tmp_path / "clones"
    for name in ("launch", "launch_ros", "launch_xml", "launch_yaml"):
        setup = f"from setuptools import setup\nsetup(name='{name}', packages=['{name}'])\n"
        if (STUB / name).is_dir():
            shutil.copytree(STUB / name, clones / name)
        else:
            write(clones / name, {"setup.py": setup, f"{name}/__init__.py": ""})
        (clones / name / "package.xml").write_text(f"<package><name>{name}</name><version>1.0.0</version></package>")
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "venv")], check=True)
    python = [str(tmp_path / "venv/bin/python"), "-m", "rosidl_py_gen.ros_cli", "launch"]
    path = os.pathsep.join((str(ROOT), sysconfig.get_path("purelib"), str(STUB / "osrf_pycommon")))
    done = started(*python, "--install", "--launch-from", str(clones), cwd=workspace, PYTHONPATH=path)
    assert (done.returncode, done.stderr) == (0, "")
    assert [line.split()[0] for line in done.stdout.splitlines()] == [
        "launch",
        "launch_xml",
        "launch_yaml",
        "launch_ros",
    ]
    origins = sorted((tmp_path / "venv/share/rosidl_py_gen/origins").iterdir())
    assert [one.stem for one in origins] == ["launch", "launch_ros", "launch_xml", "launch_yaml"]
    done = started(*python, "robot", "plain.launch.py", "--print-description", cwd=workspace, PYTHONPATH=path)
    assert (done.returncode, done.stderr) == (0, "")


def test_another_package_with_the_name_launch_is_reported(workspace: Path, tmp_path: Path) -> None:
    (tmp_path / "launch.py").write_text("")
    done = started(*LAUNCH, "robot", "robot.launch.py", cwd=workspace, PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}")
    assert (
        f"{tmp_path / 'launch.py'} is another package with the name launch; run: rosidl-py launch --install"
        in done.stderr
    )
