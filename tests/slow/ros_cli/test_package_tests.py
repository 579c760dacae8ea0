"""``rosidl-py test``: pytest in the folder of a package, with the prefix of its workspace."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.interface_packages import write
from support.prefix_workspace import write_workspace
from support.program_processes import PACKAGE_XML, started

pytestmark = pytest.mark.real_time("programs are processes")
COMMAND = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "test"]
PASSES = """
import os, subprocess
import rclpy, some_msgs.msg, py_plain.node
from ament_index_python import get_package_prefix

def test_it():
    assert os.getcwd().endswith("tested")
    node = os.path.join(get_package_prefix("cmake_all"), "lib", "cmake_all", "node.py")
    assert subprocess.check_output([node, "a"], text=True) == "node ['a']\\n"
    assert "OPENBLAS_NUM_THREADS" not in os.environ
"""
LINTER = "from ament_flake8.main import main_with_errors\n\ndef test_flake8(): assert main_with_errors() == 0\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    write_workspace(tmp_path / "src")
    tested = {
        "package.xml": PACKAGE_XML.format("tested"),
        "setup.py": "setup()",
        "test/test_passes.py": PASSES,
        "test/test_flake8.py": LINTER,
        "test/test_launch.py": "import launch_testing.actions\n\ndef generate_test_description(): 1 / 0\n",
        "test/test_broken.py": "import missing_module\n",
    }
    write(tmp_path / "src/tested", tested)
    return tmp_path


def run_tests(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return started(*COMMAND, *arguments, cwd=folder)


def test_package_is_tested_with_workspace_and_skips_missing_linters(folder: Path) -> None:
    (folder / "src/tested/test/test_broken.py").unlink()
    done = run_tests(folder, "tested", "-v")
    assert "test/test_passes.py::test_it PASSED" in done.stdout and done.returncode == 0, done.stdout
    assert "1 passed, 2 skipped" in done.stdout
    for name in ("ament_flake8", "launch_testing"):
        assert f"{name} is not installed" in done.stdout
    assert not (folder / "src/tested/.pytest_cache").exists()


def test_arguments_are_passed_to_pytest_and_its_exit_code_is_returned(folder: Path) -> None:
    done = run_tests(folder / "src/tested/test", "tested", "-q")
    assert "No module named 'missing_module'" in done.stdout and done.returncode == 2
    done = run_tests(folder, "tested", "test/test_passes.py::test_it", "-q", "-p", "no:cacheprovider")
    assert "1 passed" in done.stdout and done.returncode == 0
    assert run_tests(folder, "tested", "--no-such-option").returncode == 4


def test_tests_of_cmake_package_are_those_declared_in_cmakelists(folder: Path) -> None:
    declared = "ament_add_pytest_test(first tests/first.py)\nadd_launch_test(tests/second.py)\n"
    files = {"CMakeLists.txt": declared, "tests/first.py": PASSES, "tests/second.py": "import launch_testing\n"}
    write(folder / "src/tested", files)
    done = run_tests(folder, "tested")
    assert "1 passed, 1 skipped" in done.stdout and done.returncode == 0
    (folder / "src/tested/CMakeLists.txt").write_text(
        "foreach(t ${x})\nament_add_pytest_test(first ${t})\nendforeach()"
    )
    assert "No module named 'missing_module'" in run_tests(folder, "tested").stdout


def test_unknown_packages_are_an_error(folder: Path) -> None:
    done = run_tests(folder, "testet")
    assert done.stderr == f'error: no package "testet"; did you mean "tested"?; searched {folder / "src"}\n'
    assert run_tests(folder.parent, "--path", folder / "src", "py_plain").returncode == 5  # no tests
    assert run_tests(folder.parent, "--path", "nothing", "py_plain").returncode == 1


def test_distro_option_overrides_ros_distro(folder: Path) -> None:
    text = "import os\n\ndef test_it(): assert os.environ['ROS_DISTRO'] == 'humble'\n"
    write(folder / "src/tested/test", {"test_distro.py": text})
    words = ["--distro", "humble", "tested", "test/test_distro.py"]
    done = started(*COMMAND, *words, cwd=folder, ROS_DISTRO="jazzy")
    assert "1 passed" in done.stdout, done.stdout


def test_an_interrupt_ends_pytest(folder: Path) -> None:
    sleeps = "import time\n\ndef test_it():\n    print('now', 'asleep', flush=True)\n    time.sleep(60)\n"
    write(folder / "src/tested/test", {"test_sleeps.py": sleeps})
    command = [*COMMAND, "tested", "-s", "test/test_sleeps.py"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        while "now asleep" not in (line := process.stdout.readline()):
            assert line
        process.send_signal(signal.SIGINT)
        assert "KeyboardInterrupt" in process.stdout.read()
    assert process.returncode == 2
