"""Prefix of ``rosidl-py run``: packages that child programs find, and reasons to rebuild it."""

from __future__ import annotations

import os
import sys
import time
import venv
from pathlib import Path

import pytest
from support.interface_packages import write
from support.program_processes import PACKAGE_XML, run, started

from rosidl_py_gen.prefix.build import build_prefix
from rosidl_py_gen.prefix.environment import variables

pytestmark = [
    pytest.mark.real_time("programs are processes"),
    pytest.mark.skipif(os.name == "nt", reason="a prefix needs links and executable scripts"),
]
PARENT = """
import os, subprocess, sys
code = '''
import rclpy, my_package.text, my_interfaces.msg, std_msgs.msg
from ament_index_python.packages import get_package_share_directory
folder = get_package_share_directory("my_package")
import os
print(my_package.text.TEXT, my_interfaces.msg.Pair(a=1).a, sorted(os.listdir(folder + "/launch")), rclpy.__file__)
'''
subprocess.run([sys.executable, "-c", code], check=True)
subprocess.run(["my_script"], check=True)
if len(sys.argv) > 1:
    print([name for name in sys.modules if name.startswith("rosidl_py_gen.prefix.b")])
"""
SETUP = """
from glob import glob
from setuptools import setup
setup(
    name="my_package", packages=["my_package"], scripts=["bin/my_script"],
    data_files=[("share/my_package/launch", glob("launch/*.py"))],
)
"""


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path / "cache"))
    files = {
        "my_package/package.xml": PACKAGE_XML.format("my_package"),
        "my_package/setup.py": SETUP,
        "my_package/setup.cfg": "",
        "my_package/bin/my_script": "#!/usr/bin/env python3\nimport rclpy\nprint('script', rclpy.__name__)",
        "my_package/my_package/__init__.py": "",
        "my_package/my_package/text.py": "TEXT = 'of the workspace'",
        "my_package/launch/one.launch.py": "",
        "my_interfaces/package.xml": PACKAGE_XML.format("my_interfaces"),
        "my_interfaces/msg/Pair.msg": "int32 a\n",
    }
    write(tmp_path / "ws/src", files)
    write(tmp_path / "ws", {"parent.py": PARENT})
    return tmp_path / "ws"


def test_child_programs_find_all_packages_of_workspace(workspace: Path) -> None:
    """Children are plain Python and a script of the package; the second run uses the cached prefix."""
    found = run("parent.py", cwd=workspace)
    assert found.returncode == 0, found.stderr
    first, second = found.stdout.splitlines()
    assert first.startswith("of the workspace 1 ['one.launch.py'] ") and "ros_compat" in first
    assert second == "script rclpy"
    time.sleep(2.1)  # what has changed a moment ago is not cached
    for _ in range(2):
        found = run("parent.py", "loaded", cwd=workspace)
    assert found.stdout.splitlines() == [first, second, "[]"]
    write(workspace / "src/my_package/launch", {"two.launch.py": ""})
    found = run("parent.py", "loaded", cwd=workspace)
    assert "['one.launch.py', 'two.launch.py']" in found.stdout
    assert "['rosidl_py_gen.prefix.build']" in found.stdout


def test_child_of_script_without_workspace_imports_rclpy(tmp_path: Path) -> None:
    code = "import subprocess, sys\nsubprocess.run([sys.executable, '-c', 'import rclpy; print(rclpy.ok())'])"
    write(tmp_path, {"program.py": code})
    assert run("program.py", cwd=tmp_path, ROSIDL_PY_GEN_CACHE=str(tmp_path / "cache")).stdout == "False\n"
    assert run("program.py", cwd=tmp_path, ROSIDL_PY_GEN_CACHE="off").stdout == "False\n"


def test_unwritable_cache_is_replaced_by_temporary_folder(tmp_path: Path) -> None:
    write(tmp_path, {"program.py": "import rclpy\nprint(rclpy.ok())", "cache": "a file"})
    found = run("program.py", cwd=tmp_path, ROSIDL_PY_GEN_CACHE=str(tmp_path / "cache"))
    assert found.stdout == "False\n" and "a temporary folder is used instead of the cache" in found.stderr


CHILD = "import json, subprocess, sys; subprocess.run([sys.executable, '-c', 'import json; print(json.__file__)'])"


@pytest.mark.parametrize("place", ["cache", "cache/prefix", "cache/prefix/*", "cache/prefix/*/lib/python*/*"])
@pytest.mark.parametrize("mode", [0o777, 0o775])
def test_modules_in_prefix_writable_by_other_users_are_not_imported(workspace: Path, place: str, mode: int) -> None:
    """Other users can write into the cache, or could when the prefix was built with another umask."""
    write(workspace, {"child.py": CHILD})
    first = run("child.py", cwd=workspace)
    assert first.returncode == 0 and first.stderr == ""
    (packages,) = workspace.parent.glob("cache/prefix/*/lib/python*/site-packages")
    write(packages, {"json.py": "print('planted')"})
    packages.parents[2].chmod(0o755)
    for folder in workspace.parent.glob(place):
        folder.chmod(mode)
    second = run("child.py", cwd=workspace)
    assert (second.returncode, second.stdout) == (0, first.stdout)
    assert "can write into" in second.stderr and second.stderr.count("\n") == 1


def test_prefix_in_removed_temporary_folder_is_not_reused(workspace: Path) -> None:
    """The search of packages is cached although the prefix is not, and must not lead to a folder in /tmp."""
    write(workspace, {"child.py": "import os; print(os.environ['AMENT_PREFIX_PATH'])"})
    write(workspace.parent, {"cache/prefix": "a file"})
    (workspace.parent / "cache").chmod(0o755)
    time.sleep(2.1)  # what has changed a moment ago is not cached
    folders = [run("child.py", cwd=workspace).stdout.partition(os.pathsep)[0] for _ in range(3)]
    assert len(set(folders)) == 3 and not any(map(os.path.exists, folders))


def test_python_with_another_rclpy_imports_its_own(tmp_path: Path) -> None:
    """A program may start those of an installed ROS, whose Python does not have this package."""
    venv.create(tmp_path / "other")
    python = tmp_path / "other/bin/python"
    folder = started(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip()
    write(Path(folder), {"rclpy/__init__.py": "WHICH = 'other'", "rclpy/node.py": ""})
    environment = variables(build_prefix([], tmp_path / "out").folder)
    assert "sitecustomize" in started(sys.executable, "-c", "import sitecustomize as s; print(s)", **environment).stdout
    found = started(python, "-c", "import rclpy.node; print(rclpy.WHICH)", cwd=tmp_path, **environment)
    assert found.stdout == "other\n", found.stderr
