"""``rosidl-py run --check``: reports missing modules and names of a program without running it."""

from __future__ import annotations

import json
import os
import textwrap
from pathlib import Path

import pytest
from support.interface_packages import write
from support.program_processes import PACKAGE_XML, run

pytestmark = pytest.mark.real_time("programs are processes")


def checked(folder: Path, **files: str) -> list[str]:
    """Return the findings that are printed for ``program.py``."""
    write(folder, {f"{name}.py": textwrap.dedent(text) for name, text in files.items()})
    found = run("--check", "program.py", cwd=folder)
    assert found.stderr == ""
    *lines, last = found.stdout.splitlines()
    assert found.returncode == (1 if lines else 0)
    assert last.split()[0] == (str(len(lines)) if lines else "nothing")
    return lines


def test_complete_program_has_no_findings(tmp_path: Path) -> None:
    text = """
        import os.path
        import sys, numpy as np
        import rclpy.qos
        from rclpy import qos as quality, time
        from rclpy.duration import *
        from rclpy.exceptions import InvalidHandle
        from std_msgs.msg import String, _string
        import sensor_msgs.msg
        from std_srvs.srv._set_bool import SetBool_Request
        import helper
        from ament_index_python.packages import get_package_share_directory
        try:
            import surely_not_there
            from rclpy.qos import Nothing
        except ImportError:
            surely_not_there = None
        try:
            import json
        except ImportError:
            import nor_that
        try:
            import surely_not_there
        except ImportError:
            try:
                import nor_that
            except ImportError:
                nor_that = None
        from typing import TYPE_CHECKING
        if TYPE_CHECKING:
            from rclpy.nothing import Types

        raise SystemExit("run")

        class Profile(rclpy.qos.QoSProfile):
            own: int
            def use(self):
                self.later, self.depth, self.method(), self.own, self.__class__
                setattr(self, "later", 3)
            def method(self): return String(data="a").data, sensor_msgs.msg.LaserScan().ranges
        print(quality.HistoryPolicy.KEEP_ALL, rclpy.qos.QoSProfile.depth)
        print(String.get_fields_and_field_types, os.path.join)
    """
    assert checked(tmp_path, program=text, helper="print('run')") == []


def test_missing_names_are_reported_with_file_and_line(tmp_path: Path) -> None:
    text = """\
        import surely_not_there.inside
        import rclpy.nothing
        from rclpy.qos import QoSProfile, QoSReliablityPolicy
        from std_msgs.msg import Strin
        from surely_not_msgs.msg import A
        import helper, rclpy

        class Profile(QoSProfile):
            def use(self): return self.dept, self.depth

        print(rclpy.qos.HistoryPolicy.KEEP, rclpy.qos.Nothing, rclpy.nothing_else)
    """
    helper = "def f():\n    from rclpy.time import Tim\n"
    assert checked(tmp_path, program=text, helper=helper) == [
        'helper.py:2: rclpy.time has no Tim; did you mean "Time"?',
        "program.py:1: no package surely_not_there; it is not installed",
        "program.py:2: rclpy.nothing is not here",
        'program.py:3: rclpy.qos has no QoSReliablityPolicy; did you mean "QoSReliabilityPolicy"?',
        'program.py:4: std_msgs.msg has no Strin; did you mean "String"?',
        "program.py:5: no package surely_not_msgs; its definitions can be given with --path",
        'program.py:9: QoSProfile has no dept; did you mean "depth"?',
        "program.py:11: rclpy has no nothing_else",
        "program.py:11: rclpy.qos has no Nothing",
        "program.py:11: rclpy.qos.HistoryPolicy has no KEEP",
    ]


def test_missing_fallback_imports_are_reported(tmp_path: Path) -> None:
    text = """\
        try:
            from surely_not_there import Bus
        except Exception:
            from nor_that import Bus
        try:
            import surely_not_there
        except ImportError:
            try:
                import nor_this
            except ImportError:
                import json, last_of_all
    """
    assert checked(tmp_path, program=text) == [
        "program.py:4: no package nor_that; it is not installed",
        "program.py:11: no package last_of_all; it is not installed",
    ]


def test_modules_imported_by_package_are_checked(tmp_path: Path) -> None:
    files = {
        "src/talker/package.xml": PACKAGE_XML.format("talker"),
        "src/talker/setup.py": "setup(entry_points={'console_scripts': ['talk = talker.talk:main']})",
        "src/talker/talker/__init__.py": "",
        "src/talker/talker/talk.py": "from . import one as main\nfrom .two import Two\nimport talker.sub.three, near",
        "src/talker/talker/one.py": "import missing_one",
        "src/talker/talker/two.py": "from .sub import three\nimport missing_two",
        "src/talker/talker/sub/__init__.py": "",
        "src/talker/talker/sub/three.py": "from ..one import y\nimport missing_three",
        "src/near/package.xml": PACKAGE_XML.format("near"),
        "src/near/near/__init__.py": "import missing_near",
    }
    write(tmp_path, files)
    for words in (["talker", "talk"], ["-m", "talker.talk"], ["src/talker/talker/talk.py"]):
        found = run("--check", *words, cwd=tmp_path)
        names = sorted(line.split("no package ")[1].split(";")[0] for line in found.stdout.splitlines()[:-1])
        assert names == ["missing_near", "missing_one", "missing_three", "missing_two"], (words, found)
    as_json = json.loads(run("--check", "--json", "talker", "talk", cwd=tmp_path).stdout)
    assert (as_json["files"], sorted(one["line"] for one in as_json["missing"])) == (7, [1, 1, 2, 2])
    assert as_json["missing"][0].keys() == {"file", "line", "text"}


@pytest.mark.parametrize(
    "line",
    [
        "from .sub.mod import X",
        "from .sub.deep.mod import X",
        "from . import sub",
        "from .sub import mod",
        "from talker.sub.mod import X",
        "import talker.sub.deep.mod",
        "from .sub.nowhere import X",
    ],
)
def test_folder_without_init_is_read_as_a_namespace_package(tmp_path: Path, line: str) -> None:
    files = {
        "src/talker/package.xml": PACKAGE_XML.format("talker"),
        "src/talker/setup.py": "setup(entry_points={'console_scripts': ['talk = talker.talk:main']})",
        "src/talker/talker/__init__.py": "",
        "src/talker/talker/talk.py": f"{line}\nimport missing_one",
        "src/talker/talker/sub/mod.py": "X = 1\nimport missing_two",
        "src/talker/talker/sub/deep/mod.py": "X = 1\nimport missing_three",
    }
    write(tmp_path, files)
    found = run("--check", "talker", "talk", cwd=tmp_path)
    assert "no package missing_one" in found.stdout and found.stderr == "" and found.returncode == 1
    expected = {"from .sub.mod": "missing_two", "from .sub.deep": "missing_three", "import talker": "missing_three"}
    for start, name in expected.items():
        assert (name in found.stdout) or not line.startswith(start)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no prefix, in which programs find these modules")
def test_modules_that_packages_install_from_elsewhere_are_found_and_checked(tmp_path: Path) -> None:
    files = {
        "src/talker/package.xml": PACKAGE_XML.format("talker"),
        "src/talker/CMakeLists.txt": """
            ament_python_install_package(parts PACKAGE_DIR python/odd)
            install(PROGRAMS scripts/talk.py DESTINATION lib/${PROJECT_NAME})
        """,
        "src/talker/python/odd/__init__.py": "",
        "src/talker/python/odd/inner.py": "from .near import X\nimport missing_one",
        "src/talker/python/odd/near.py": "X = 1",
        "src/talker/scripts/talk.py": "import rclpy\nfrom parts.inner import X\nimport odd_tools\nimport missing_two",
        "src/all_tools/package.xml": PACKAGE_XML.format("all_tools"),
        "src/all_tools/setup.py": "setup(py_modules=['odd_tools'], package_dir={'': 'lib'})",
        "src/all_tools/lib/odd_tools.py": "import missing_three",
    }
    write(tmp_path, {path: textwrap.dedent(text) for path, text in files.items()})
    *lines, last = run("--check", "talker", "talk.py", cwd=tmp_path).stdout.splitlines()
    assert lines == [
        "src/all_tools/lib/odd_tools.py:1: no package missing_three; it is not installed",
        "src/talker/python/odd/inner.py:2: no package missing_one; it is not installed",
        "src/talker/scripts/talk.py:4: no package missing_two; it is not installed",
    ]
    assert last == "3 missing in 4 files"


def test_missing_modules_of_workspace_packages_are_reported(tmp_path: Path) -> None:
    files = {
        "src/talker/package.xml": PACKAGE_XML.format("talker"),
        "src/talker/setup.py": "setup(entry_points={'console_scripts': ['talk = talker.talk:main']})",
        "src/talker/talker/__init__.py": "",
        "src/talker/talker/talk.py": """
            from .one import main
            from .built import X
            import talker.parts.more
            try:
                from .perhaps import X
            except ImportError:
                X = None
        """,
        "src/talker/talker/one.py": "def main(): pass",
    }
    write(tmp_path, {path: textwrap.dedent(text) for path, text in files.items()})
    *lines, _ = run("--check", "talker", "talk", cwd=tmp_path).stdout.splitlines()
    assert lines == [
        "src/talker/talker/talk.py:3: no module talker.built in src/talker/talker",
        "src/talker/talker/talk.py:4: no module talker.parts.more in src/talker/talker",
    ]


def test_missing_module_of_console_script_is_an_error(tmp_path: Path) -> None:
    files = {
        "src/talker/package.xml": PACKAGE_XML.format("talker"),
        "src/talker/setup.py": """
            setup(entry_points={"console_scripts": ["talk = talker.client:main", "x = talker.x.y:main"]})
        """,
        "src/talker/talker/__init__.py": "",
        "src/talker/talker/cilent.py": "def main(): pass",
    }
    write(tmp_path, {path: textwrap.dedent(text) for path, text in files.items()})
    expected_text = 'error: no source of the module "talker.client" was found; did you mean "cilent"?\n'
    assert run("--check", "talker", "talk", cwd=tmp_path).stderr == expected_text
    assert (
        run("--check", "talker", "x", cwd=tmp_path).stderr
        == expected_text.partition(";")[0].replace("client", "x.y") + "\n"
    )


@pytest.mark.parametrize(
    ("text", "expected_text"),
    [
        ("", "talker.talk has no main; the executable calls it"),
        ("def mian(): pass", 'talker.talk has no main; did you mean "mian"?; the executable calls it'),
        ("async def main(): pass", None),
        ("main = print", None),
        ("from .other import run as main", None),
        ("from .other import *", None),
        ("def __getattr__(name): return print", None),
        ("globals()['main'] = print", None),
    ],
)
def test_missing_function_of_console_script_is_reported(tmp_path: Path, text: str, expected_text: str | None) -> None:
    files = {
        "src/talker/package.xml": PACKAGE_XML.format("talker"),
        "src/talker/setup.py": "setup(entry_points={'console_scripts': ['talk = talker.talk:main']})",
        "src/talker/talker/__init__.py": "",
        "src/talker/talker/talk.py": text,
        "src/talker/talker/other.py": "run = print",
    }
    write(tmp_path, files)
    *lines, last = run("--check", "talker", "talk", cwd=tmp_path).stdout.splitlines()
    assert lines == ([f"src/talker/talker/talk.py:1: {expected_text}"] if expected_text else []) and "missing" in last


def test_module_imported_under_package_name_is_checked(tmp_path: Path) -> None:
    write(tmp_path, {"program.py": "import std_msgs.msg as std_msgs\nprint(std_msgs.String(), std_msgs.Strin())"})
    found = run("--check", "program.py", cwd=tmp_path)
    assert found.stdout.splitlines()[:-1] == ['program.py:2: std_msgs.msg has no Strin; did you mean "String"?'], found


@pytest.mark.parametrize("text", ["x = = 3", "x = '\0'", "(" * 100_000])
def test_invalid_python_file_is_reported(tmp_path: Path, text: str) -> None:
    write(tmp_path, {"program.py": text})
    found = run("--check", "program.py", cwd=tmp_path)
    assert found.returncode == 1 and "Traceback" not in found.stderr
    assert "program.py" in found.stdout + found.stderr


def test_module_requiring_missing_extra_names_it(tmp_path: Path) -> None:
    blocker = "import sys\nsys.modules['transforms3d'] = None\n"
    write(tmp_path, {"sitecustomize.py": blocker, "program.py": "import rclpy\nimport tf_transformations\n"})
    found = run("--check", "program.py", cwd=tmp_path, PYTHONPATH=str(tmp_path))
    line = found.stdout.splitlines()[0]
    assert line.startswith("program.py:2: tf_transformations: this needs transforms3d, which is not installed: pip ")
    assert found.returncode == 1
