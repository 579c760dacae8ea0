"""``rosidl-py run``: programs behave and find modules as with Python itself."""

from __future__ import annotations

import json
import re
import signal
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.interface_packages import write
from support.program_processes import PACKAGE_XML, SETUP_CFG, run, started

pytestmark = pytest.mark.real_time("programs are processes")


@pytest.fixture(autouse=True, scope="module")
def _cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


# --- as python --------------------------------------------------------------------------------------------------------

PROGRAMS = {
    "what it is": """
        import sys
        main = sys.modules["__main__"]
        names = ("__name__", "__file__", "__spec__", "__package__", "__cached__", "__doc__", "__builtins__")
        print([getattr(main, name) for name in names], type(main.__loader__).__name__, main.__dict__ is globals())
        print(sys.argv, sys.path[0], __annotations__)
    """,
    "siblings": "import sibling\nprint(sibling.__file__)",
    "exit text": "import sys\nsys.exit('gone')",
    "chained": "try:\n    1 / 0\nexcept ZeroDivisionError as error:\n    raise ValueError('x') from error",
    "in another module": "import sibling\nsibling.fail()",
    "not there": "import nothing_of_that_name",
    "syntax": "print('x'\nx = = 3",
    "not utf-8": "# coding: latin-1\nprint('\\xe4')",
    "hook of its own": "import sys\nsys.excepthook = lambda *given: print('hook', given[0].__name__)\n1 / 0",
    "at the end": "import atexit, sys\natexit.register(print, 'end')\nsys.exit(3)",
    "threads go on": """
        import atexit, threading
        atexit.register(print, "end")
        event = threading.Event()
        threading.Thread(target=lambda: (event.wait(), print('thread'))).start()
        event.set()
        1 / 0
    """,
    "interrupted": "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nwhile True: pass",
    "terminated": "import os, signal\nos.kill(os.getpid(), signal.SIGTERM)\nwhile True: pass",
    "handlers": """
        import signal
        names = ("SIGINT", "SIGTERM", "SIGPIPE", "SIGHUP")
        print([str(signal.getsignal(getattr(signal, name))) for name in names])
    """,
    "system settings": """
        import gc, os, sys, warnings
        print(gc.get_threshold(), os.environ.get("OPENBLAS_NUM_THREADS"), sys.flags, sys.stdout.line_buffering)
        warnings.warn("seen")
    """,
    "pickled": """
        import pickle
        class A: pass
        print(type(pickle.loads(pickle.dumps(A()))) is A)
    """,
    "a process of its own": """
        import multiprocessing
        def work(queue): queue.put("worked")
        if __name__ == "__main__":
            context = multiprocessing.get_context("fork")
            queue = context.Queue()
            process = context.Process(target=work, args=(queue,))
            process.start()
            print(queue.get())
            process.join()
    """,
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_program_file_behaves_as_with_python(name: str, tmp_path: Path) -> None:
    files = {"folder/program.py": textwrap.dedent(PROGRAMS[name]), "folder/sibling.py": "def fail():\n    1 / 0\n"}
    write(tmp_path, files)
    program = Path("folder/program.py")
    arguments = ["a", "--help", "--check", "--", "--ros-args", "-r", "x:=y", "-m"]
    expected = started(sys.executable, program, *arguments, cwd=tmp_path)
    found = run(program, *arguments, cwd=tmp_path)
    assert (found.stdout, found.stderr, found.returncode) == (expected.stdout, expected.stderr, expected.returncode)
    assert found.stdout or found.stderr or found.returncode < 0


@pytest.mark.parametrize(
    "name", ["pack", "pack.tool", "pack.nothing", "pack.wrong", "pack.inner", "a-b", "json.nothing"]
)
def test_module_behaves_as_with_python(name: str, tmp_path: Path) -> None:
    files = {
        "pack/__init__.py": "",
        "pack/__main__.py": "from pack.tool import main\nmain()\nprint(__name__, __spec__.name, __package__)",
        "pack/tool.py": """
            import sys
            from . import other

            def main(): print(other.A, sys.argv, sys.path[0], __name__, __package__)

            if __name__ == "__main__":
                main()
        """,
        "pack/other.py": "A = 5",
        "pack/wrong.py": "from .other import B",
        "pack/inner/__init__.py": "",
    }
    write(tmp_path, {path: textwrap.dedent(text) for path, text in files.items()})
    expected = started(sys.executable, "-m", name, "a", "--help", cwd=tmp_path)
    found = run("-m", name, "a", "--help", cwd=tmp_path)
    assert found.returncode == expected.returncode
    assert found.stdout == expected.stdout
    if name == "pack.wrong":
        # Without the frames of runpy; 3.10 shows their lines, too.
        assert found.stderr == re.sub(r'  File "[^"]*runpy[^"]*".*\n(    .*\n)?', "", expected.stderr)
    elif expected.returncode:
        assert found.stderr.startswith("error: ") and name.split(".")[0] in found.stderr


# --- what is there ----------------------------------------------------------------------------------------------------


def test_ctrl_c_in_weakref_callback_ends_program(tmp_path: Path) -> None:
    """The import system has such callbacks, while a program starts."""
    program = """
        import os, signal, time, weakref
        class Thing: pass
        thing = Thing()
        reference = weakref.ref(thing, lambda one: (os.kill(os.getpid(), signal.SIGINT), [*range(9)]))
        del thing
        time.sleep(99)
    """
    (tmp_path / "program.py").write_text(textwrap.dedent(program))
    done = run("program.py", cwd=tmp_path)
    assert done.returncode == -signal.SIGINT
    lines = done.stderr.splitlines()
    assert "    time.sleep(99)" in lines[-3:] and lines[-1] == "KeyboardInterrupt"  # carets may follow the line


def test_path_option_provides_definitions(tmp_path: Path) -> None:
    write(tmp_path, {"more/own_msgs/msg/A.msg": "int32 a", "program.py": "from own_msgs.msg import A\nprint(A(a=3).a)"})
    assert run("--path", tmp_path / "more", tmp_path / "program.py").stdout == "3\n"
    assert run(f"--path={tmp_path / 'more'}", tmp_path / "program.py").stdout == "3\n"


def test_path_option_accepts_packages_without_definitions(tmp_path: Path) -> None:
    setup = "from setuptools import setup\nsetup(entry_points={'console_scripts': ['hello = greeter.hello:main']})"
    hello = "from std_msgs.msg import String\ndef main(): print(String(data='a').data)"
    files = {
        "package.xml": "<name>greeter</name>",
        "setup.py": setup,
        "setup.cfg": SETUP_CFG.format("greeter"),
        "greeter/__init__.py": "",
        "greeter/hello.py": hello,
    }
    write(tmp_path, {f"src/greeter/{name}": text for name, text in files.items()})
    (tmp_path / "empty").mkdir()
    write(tmp_path, {"others.py": "from greeter.hello import main\nmain()"})
    assert run("--path", "src", "others.py", cwd=tmp_path).stdout == "a\n"
    for path in ("src", "src/greeter"):
        found = run("--path", path, "greeter", "hello", cwd=tmp_path)
        assert (found.stdout, found.stderr) == ("a\n", "")
    found = run("--path", "empty", "src/greeter/greeter/hello.py", cwd=tmp_path)
    assert found.returncode == 1
    assert "empty: expected a package with definitions (in a folder msg, srv or action), found none" in found.stderr


def test_program_has_workspace_packages_ros_variables_and_arguments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = """
        import os, sys
        from greeter.hello import NAME
        print(NAME, [os.environ[name] for name in ("ROS_VERSION", "ROS_PYTHON_VERSION", "ROS_DISTRO")], sys.argv[1:])
    """
    files = {
        "ws/greeter/package.xml": "<name>greeter</name>",
        "ws/greeter/greeter/__init__.py": "",
        "ws/greeter/greeter/hello.py": "NAME = 'a'",
        "own/greeter/notes.txt": "a folder without modules",
        "own/program.py": textwrap.dedent(program),
    }
    write(tmp_path, files)
    monkeypatch.delenv("ROS_VERSION", raising=False)
    monkeypatch.setenv("ROS_DISTRO", "kilted")
    found = run("--path", "ws", "own/program.py", "--check", cwd=tmp_path)
    assert found.stdout == "a ['2', '3', 'kilted'] ['--check']\n"
    note = "note: --check is passed to the program; for the option use rosidl-py run --check PROGRAM\n"
    assert found.stderr == note


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Folder of a workspace that was not built."""
    files = {
        "src/talker/package.xml": PACKAGE_XML.format("talker"),
        "src/talker/setup.py": """
            import os
            from setuptools import setup

            package_name = "talker"
            open(os.path.join(os.path.dirname(__file__), "was_run"), "w")
            setup(
                name=package_name,
                entry_points={
                    "console_scripts": [
                        "talk = talker.talk:main",
                        package_name + "_two = " + package_name + ".talk:Other.main",
                        f"three = {package_name}.sub.three:main",
                        "four = {0}.talk:fail".format(package_name),
                        "five = %s.talk:main" % package_name,
                    ],
                },
            )
        """,
        "src/talker/setup.cfg": SETUP_CFG.format("talker"),
        "src/talker/talker/__init__.py": "",
        "src/talker/talker/talk.py": """
            import sys
            from ament_index_python.packages import get_package_share_directory
            from near_msgs.msg import A
            from near_msgs.tools import triple
            from .other import NAME

            def main():
                print(NAME, triple(A(a=5).a), sys.argv[1:], __name__, sys.modules["__main__"].__name__)
                with open(get_package_share_directory("talker") + "/config/a.yaml") as file:
                    print(file.read())
                return 4

            class Other:
                @staticmethod
                def main(): print("two")

            def fail():
                raise ValueError("failed")

            if __name__ == "__main__":
                main()
        """,
        "src/talker/talker/other.py": "NAME = 'talker'",
        "src/talker/talker/sub/__init__.py": "",
        "src/talker/talker/sub/three.py": "from ..other import NAME\n\ndef main(): print('three', NAME)\n",
        "src/talker/config/a.yaml": "a: 1",
        "src/group/near_msgs/package.xml": PACKAGE_XML.format("near_msgs"),
        "src/group/near_msgs/msg/A.msg": "int32 a",
        "src/group/near_msgs/near_msgs/__init__.py": "",
        "src/group/near_msgs/near_msgs/tools.py": "def triple(x): return 3 * x",
        "src/group/near_msgs/CMakeLists.txt": """
            project(near_msgs)
            set(SCRIPTS scripts/one.py "scripts/two")
            install(PROGRAMS ${SCRIPTS} DESTINATION lib/${PROJECT_NAME})
            install(PROGRAMS scripts/long_name.py DESTINATION lib/${PROJECT_NAME} RENAME short)
            install(PROGRAMS scripts/binary DESTINATION lib/${PROJECT_NAME})
        """,
        "src/group/near_msgs/scripts/one.py": "from near_msgs.tools import triple\nprint('one', triple(1))",
        "src/group/near_msgs/scripts/two": "#!/usr/bin/env python3\nprint('two', __file__.endswith('two'))",
        "src/group/near_msgs/scripts/long_name.py": "print('long')",
        "src/group/near_msgs/scripts/binary": "\\x7fELF",
        "src/ignored/COLCON_IGNORE": "",
        "src/ignored/talker/package.xml": PACKAGE_XML.format("ignored"),
    }
    return write(tmp_path / "ws", {path: textwrap.dedent(text) for path, text in files.items()})


@pytest.mark.parametrize("place", ["", "src", "src/talker", "src/talker/talker", "src/group"])
def test_executable_of_unbuilt_workspace_runs(workspace: Path, place: str) -> None:
    found = run("talker", "talk", "a", "--ros-args", "-p", "x:=1", cwd=workspace / place)
    if place == "src/group":  # src is above a package only
        assert found.returncode == 1 and 'no package "talker"' in found.stderr
        return
    assert found.stderr == ""
    text = "talker 15 ['a', '--ros-args', '-p', 'x:=1'] talker.talk __main__\na: 1\n"
    assert (found.stdout, found.returncode) == (text, 4)
    assert not (workspace / "src/talker/was_run").exists()


@pytest.mark.parametrize("place", ["", "src", "src/talker", "src/group"])
def test_script_outside_packages_uses_workspace_of_current_folder(workspace: Path, place: str) -> None:
    text = "from near_msgs.msg import A\nfrom near_msgs.tools import triple\nprint(triple(A(a=1).a))"
    script = write(workspace / "scripts", {"new.py": text}) / "new.py"
    checked, found = run("--check", script, cwd=workspace / place), run(script, cwd=workspace / place)
    if place == "src/group":  # neither a workspace, nor in a package of one: it is not searched
        assert checked.returncode == 1 and "no package near_msgs" in checked.stdout
        assert found.returncode == 1 and "No module named 'near_msgs'\n" in found.stderr
        return
    assert (checked.stdout, checked.returncode) == ("nothing missing in 2 files\n", 0)
    assert (found.stdout, found.stderr) == ("3\n", "")


WAYS = {"executable": ["talker", "talk"], "file": ["python/talker/talker/talk.py"]}


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository whose packages are in folders of other names than `src`."""
    files = {
        "python/talker/package.xml": PACKAGE_XML.format("talker"),
        "python/talker/setup.py": "setup(entry_points={'console_scripts': ['talk = talker.talk:main']})",
        "python/talker/setup.cfg": SETUP_CFG.format("talker"),
        "python/talker/talker/__init__.py": "",
        "python/talker/talker/talk.py": """
            from talker.msg import Own
            try:
                from far_msgs.msg import A as Other
            except ImportError:
                Other = None

            def main(): print(Own(own=5).own, Other and Other(a=2).a)

            if __name__ == "__main__":
                main()
        """,
        "python/talker/msg/Own.msg": "int32 own",
        "interfaces/far_msgs/package.xml": PACKAGE_XML.format("far_msgs"),
        "interfaces/far_msgs/msg/A.msg": "int32 a",
    }
    return write(tmp_path, {path: textwrap.dedent(text) for path, text in files.items()})


@pytest.mark.parametrize("way", WAYS)
def test_packages_without_src_folder_use_current_folder_as_workspace(repository: Path, way: str) -> None:
    found = run(*WAYS[way], cwd=repository)
    assert (found.stdout, found.stderr) == ("5 2\n", "")
    assert run(*WAYS["executable"], cwd=repository / "python").stdout == "5 None\n"  # far_msgs is not below


def test_program_uses_its_own_package_before_another_with_same_name(repository: Path) -> None:
    write(
        repository, {"a_copy/talker/package.xml": PACKAGE_XML.format("talker"), "a_copy/talker/msg/Own.msg": "int32 x"}
    )
    assert run(*WAYS["file"], cwd=repository).stdout == "5 None\n"


@pytest.mark.parametrize(
    ("package", "name", "output"),
    [
        ("talker", "talker_two", "two\n"),
        ("talker", "three", "three talker\n"),
        ("near_msgs", "one.py", "one 3\n"),
        ("near_msgs", "two", "two True\n"),
        ("near_msgs", "short", "long\n"),
    ],
)
def test_executables_of_all_declaration_forms_run(workspace: Path, package: str, name: str, output: str) -> None:
    found = run(package, name, cwd=workspace)
    assert (found.stdout, found.stderr, found.returncode) == (output, "", 0)


def test_failing_console_script_shows_only_its_own_frames(workspace: Path) -> None:
    found = run("talker", "four", cwd=workspace)
    assert found.returncode == 1 and found.stderr.count('File "') == 1
    assert found.stderr.endswith("ValueError: failed\n")


@pytest.mark.parametrize(
    "way", [["src/talker/talker/talk.py"], ["-m", "talker.talk"], ["--path", "src", "-m", "talker.talk"]]
)
def test_files_and_modules_of_packages_run(workspace: Path, way: list[str]) -> None:
    found = run(*way, "b", cwd=workspace)
    assert (found.stdout, found.stderr) == ("talker 15 ['b'] __main__ __main__\na: 1\n", "")


def test_list_option_prints_executables(workspace: Path) -> None:
    listed = run("--list", cwd=workspace).stdout.splitlines()
    names = ["binary", "one.py", "short", "two"]
    assert listed == [
        *(f"near_msgs {name}" for name in names),
        *(f"talker {name}" for name in ["five", "four", "talk", "talker_two", "three"]),
    ]
    assert run("--list", "talker", cwd=workspace).stdout.splitlines() == listed[4:]
    rows = [dict(zip(("package", "executable"), line.split(), strict=True)) for line in listed]
    assert json.loads(run("--list", "--json", cwd=workspace).stdout) == rows


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["talker"], "expected an executable of talker"),
        (["talker", "tolk"], 'has no executable "tolk"; did you mean "talk"?'),
        (["tolker", "talk"], 'no package "tolker"; did you mean "talker"?'),
        (["near_msgs", "binary"], "is not a Python program"),
        (["nothing.py"], "nothing.py: expected a Python file, no such file"),
        (["./src"], "src: expected a Python file, it is a folder"),
        (["-m", "talker"], '"talker" is a package without a module __main__'),
        (["-m", "talker..talk"], "talker"),
        (["-m"], "expected a module after -m"),
        ([], "error: rosidl-py run: expected a file, -m and a module, or a package and an executable"),
        (["--nothing", "talker"], "--nothing"),
        (["--path", "nowhere", "src/talker/talker/talk.py"], "nowhere: expected a folder"),
    ],
)
def test_invalid_programs_are_reported(workspace: Path, words: list[str], text: str) -> None:
    found = run(*words, cwd=workspace)
    assert text in (found.stderr if words else found.stdout + found.stderr) and "Traceback" not in found.stderr
    assert found.returncode in (1, 2) or not words


def test_executables_of_ament_prefix_run_and_are_listed(tmp_path: Path) -> None:
    write(
        tmp_path,
        {"lib/installed/node": "#!/usr/bin/python3\nimport sys\nprint(sys.argv[1:])", "lib/installed/data": ""},
    )
    (tmp_path / "lib/installed/node").chmod(0o755)
    settings = {"AMENT_PREFIX_PATH": str(tmp_path), "cwd": tmp_path}
    assert run("installed", "node", "a", **settings).stdout == "['a']\n"  # type: ignore[arg-type]
    assert run("--list", "installed", **settings).stdout == "installed node\n"  # type: ignore[arg-type]


def test_console_script_of_installed_distribution_runs(tmp_path: Path) -> None:
    found = run("pytest", "py.test", "--version", cwd=tmp_path)
    assert found.returncode == 0 and "pytest" in found.stdout


def test_real_rclpy_on_path_causes_one_line_warning(tmp_path: Path) -> None:
    files = {
        "real/rclpy/__init__.py": "WHICH = 'real'",
        "real/std_msgs/__init__.py": "",
        "real/std_msgs/msg/__init__.py": "",
        "program.py": "import ament_index_python, rclpy, std_msgs.msg\nprint(rclpy.__file__, std_msgs.msg.String())",
    }
    write(tmp_path, files)
    found = run(tmp_path / "program.py", PYTHONPATH=str(tmp_path / "real"))
    assert found.stderr.startswith("warning: rclpy comes from rosidl-py-gen") and found.stderr.count("\n") == 1
    assert str(tmp_path / "real/rclpy") in found.stderr
    assert "rosidl_py_gen" in found.stdout and "String(data='')" in found.stdout
