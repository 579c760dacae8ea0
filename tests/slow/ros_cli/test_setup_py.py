"""A setup.py that cannot be analyzed completely, with commands that execute it and commands that do not."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import textwrap
import time
import venv
from pathlib import Path

import pytest
from support.interface_packages import write
from support.program_processes import PACKAGE_XML, SETUP_CFG, run, started
from support.waiting import wait_until

from rosidl_py_gen.prefix import setup_process
from rosidl_py_gen.prefix.build import build_prefix
from rosidl_py_gen.prefix.environment import SITE_PACKAGES, variables
from rosidl_py_gen.prefix.setup_process import SetupRunError, run_setup_py
from rosidl_py_gen.type_loading import scan_cache
from rosidl_py_gen.type_loading.import_hook import FoundPackage, ImportHookWarning
from rosidl_py_gen.type_loading.setup_reader.setup_py import SetupArguments

pytestmark = [
    pytest.mark.real_time("programs are processes"),
    pytest.mark.skipif(os.name == "nt", reason="a prefix needs links and executable scripts"),
]
SETUP = """
import os
from setuptools import setup

open("was_run", "a").write("1")

class Rows(list):
    def add(self, folder, place):
        self.append(("share/foo/" + place, [os.path.join(folder, name) for name in os.listdir(folder)]))
        return self

rows = [("share/foo", ["package.xml"])]
rows += Rows().add("params", "config")
names = ["n1 = foo.n1:main"]
names += Rows(["n2 = foo.n1:main"])
setup(name="foo", version="1.0.0", packages=["foo"], data_files=rows, entry_points={"console_scripts": names})
"""
PROGRAM = """
import os
from ament_index_python.packages import get_package_share_directory

def main():
    print(os.path.exists(get_package_share_directory("foo") + "/config/a.yaml"))

if __name__ == "__main__":
    main()
"""
COMMAND = [sys.executable, "-m", "rosidl_py_gen.ros_cli"]


@pytest.fixture(autouse=True)
def _environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path / "cache"))


def write_package(tmp_path: Path, setup: str = SETUP, **more: str) -> Path:
    files = {
        "package.xml": PACKAGE_XML.format("foo"),
        "setup.py": textwrap.dedent(setup),
        "setup.cfg": SETUP_CFG.format("foo"),
        "foo/__init__.py": "",
        "foo/n1.py": PROGRAM,
        "params/a.yaml": "a: 1",
    }
    write(tmp_path / "ws/src/foo", {**files, **{name.replace("__", "."): text for name, text in more.items()}})
    return tmp_path / "ws/src/foo"


def times_run(package: Path) -> int:
    file = package / "was_run"
    return len(file.read_text()) if file.exists() else 0


def test_run_command_executes_ambiguous_setup_py_once_with_note(tmp_path: Path) -> None:
    package = write_package(tmp_path)
    found = run("foo", "n2", cwd=package)
    assert (found.stdout, found.returncode) == ("True\n", 0)
    assert found.stderr == (
        "note: running setup.py, because data_files are not known without it: the method add in line 13\n"
    ) or found.stderr.startswith("note: running setup.py, because data_files are not known without it: ")
    assert len(found.stderr.splitlines()) == 1 and times_run(package) == 1
    time.sleep(2.1)  # files that have changed a moment ago are not cached
    run("foo", "n2", cwd=package)
    before = times_run(package)
    for words in (["foo", "n2"], ["foo/n1.py"]):
        found = run(*words, cwd=package)
        assert (found.stdout, found.stderr) == ("True\n", "")
    assert times_run(package) == before
    write(package, {"params/b.yaml": "b: 1"})
    assert "note: running setup.py" in run("foo", "n1", cwd=package).stderr


def test_read_only_commands_link_all_files_of_ambiguous_setup_py(tmp_path: Path) -> None:
    package = write_package(tmp_path, top__txt="a")
    found = started(*COMMAND, "prefix", "src", "--out", "out", cwd=tmp_path / "ws")
    share = tmp_path / "ws/out/share/foo"
    assert (share / "params/a.yaml").is_file() and (share / "top.txt").is_file()
    assert not (share / "setup.py").exists() and not (share / "foo/n1.py").exists()
    first, second = found.stderr.splitlines()
    assert first.startswith("note: foo: data_files of src/foo/setup.py are not known without running it: ")
    assert "in line" in first and "share/foo has all files of the package" in first
    assert second.startswith("warning: foo (src/foo): entry_points of src/foo/setup.py are not known")
    assert (tmp_path / "ws/out/lib/foo/n1").is_file()
    listed = run("--list", "foo", cwd=tmp_path / "ws")
    assert listed.stdout == "foo n1\n" and "there may be other executables" in listed.stderr
    assert run("--check", "foo", "n1", cwd=tmp_path / "ws").returncode == 0
    with pytest.warns(ImportHookWarning, match=r"data_files of .*setup\.py are not known without running it"):
        assert FoundPackage("foo", package, ()).share == package
    assert times_run(package) == 0


def test_test_command_executes_ambiguous_setup_py(tmp_path: Path) -> None:
    test = (
        "from foo.n1 import main\ndef test_share(capsys):\n    main()\n    assert capsys.readouterr().out == 'True\\n'"
    )
    package = write_package(tmp_path)
    write(package, {"test/share_test.py": test})
    found = started(*COMMAND, "test", "foo", cwd=tmp_path / "ws")
    assert "1 passed" in found.stdout and "note: running src/foo/setup.py" in found.stderr


def test_expensive_setup_py_yields_literals_unless_executed(tmp_path: Path) -> None:
    setup = """
    from setuptools import setup
    rows = []
    for number in range(1_000_000):
        rows = [("share/foo", ["params/a.yaml"])]
    setup(name="foo", packages=["foo"], data_files=rows,
          entry_points={"console_scripts": ["n1 = foo.n1:main", "n%d = foo.n1:main" % 2]})
    """
    options = "[options]\nscripts = params/a.yaml\n"
    package = write_package(tmp_path, setup, setup__cfg=SETUP_CFG.format("foo") + options)
    made = build_prefix([package], tmp_path / "out")
    assert {*os.listdir(made.folder / "lib/foo")} == {"n1", "a.yaml"}
    assert (made.folder / SITE_PACKAGES / "foo/n1.py").is_file()
    assert (made.folder / "share/foo/params/a.yaml").is_file()
    assert "executables may be missing" in made.problems[0] and len(made.problems) == 1
    assert "takes more work than a package can need" in made.notes[0] and len(made.notes) == 1
    made = build_prefix([package], tmp_path / "run", runs_setup=True)
    assert {*os.listdir(made.folder / "lib/foo")} == {"n1", "n2", "a.yaml"} and made.problems == ()
    assert (made.folder / "share/foo/a.yaml").is_file() and not (made.folder / "share/foo/params").exists()


def test_computed_cmdclass_makes_data_files_uncertain(tmp_path: Path) -> None:
    setup = """
    import os
    from setuptools import setup
    commands = {}
    if os.environ.get("PATH"):
        commands["install"] = unknown
    setup(name="foo", packages=["foo"], data_files=[("share/foo", ["params/a.yaml"])], cmdclass=commands)
    """
    made = build_prefix([write_package(tmp_path, setup)], tmp_path / "out")
    assert "data_files of" in made.notes[0] and "cmdclass" in made.notes[0]


def test_cached_setup_py_result_depends_on_environment_variables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = write_package(
        tmp_path,
        """
        import os
        from setuptools import setup
        setup(name="foo", packages=["foo"], data_files=[("share/foo", [os.environ["ANY_NAME"]])])
        """,
    )
    monkeypatch.setattr(scan_cache, "MIN_AGE_NS", 0)  # files that have changed a moment ago are cached, too
    for value in ("params/a.yaml", "setup.cfg"):
        monkeypatch.setenv("ANY_NAME", value)
        assert SetupArguments.of_calls(run_setup_py(package, "it must")).values["data_files"] == [
            ["share/foo", [value]]
        ]
    code = f"""
from pathlib import Path
from rosidl_py_gen.prefix.setup_process import run_setup_py
from rosidl_py_gen.type_loading import scan_cache
from rosidl_py_gen.type_loading.setup_reader.setup_py import SetupArguments
scan_cache.MIN_AGE_NS = 0
print(SetupArguments.of_calls(run_setup_py(Path({str(package)!r}), "it must")).values["data_files"])
"""
    for value in ("package.xml", "foo/n1.py"):
        assert started(sys.executable, "-c", code, ANY_NAME=value).stdout == f"[['share/foo', ['{value}']]]\n"


def test_exception_after_setup_call_keeps_its_arguments(tmp_path: Path) -> None:
    package = write_package(tmp_path, SETUP + "\nraise ValueError('after the call')\n")
    found = run("foo", "n2", cwd=package)
    assert (found.stdout, found.returncode) == ("True\n", 0)


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("raise ValueError('no network')", "ValueError: no network"),
        ("import sys; sys.exit(3)", "setup.py ends with status 3 before it calls setup"),
        ("setup = dict", "setup.py does not call setup of setuptools or distutils"),
        ("import os; os._exit(5)", "it ended with status 5"),
        ("print('\\x1b[31m'); raise ValueError('\\x1b[31m')", "ValueError: \ufffd[31m"),
    ],
)
def test_failing_setup_py_is_a_warning_and_all_files_are_linked(code: str, reason: str, tmp_path: Path) -> None:
    package = write_package(tmp_path, SETUP.replace("rows = [", f"if os.environ.get('PATH'):\n    {code}\nrows = ["))
    found = run("foo", "n1", cwd=package)
    assert found.stdout == "False\n"
    assert f"warning: setup.py cannot be run: {reason}" in found.stderr
    assert found.stderr.count("cannot be run") == 1
    [prefix] = (tmp_path / "cache/prefix").iterdir()
    assert (prefix / "share/foo/params/a.yaml").is_file()


def is_alive(process: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return False


def test_endless_setup_py_is_killed_with_its_child_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Process(subprocess.Popen[bytes]):
        """The time begins when setup.py has started its child, however slow the machine is."""

        def wait(self, timeout: float | None = None) -> int:
            if timeout is not None:
                wait_until(lambda: child_file.exists() and child_file.read_text())
            return super().wait(timeout)

    monkeypatch.setattr(setup_process, "TIMEOUT_S", 0.5)
    monkeypatch.setattr(subprocess, "Popen", Process)
    code = """
    import os, subprocess, sys, time
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    open("child", "w").write(str(child.pid))
    while True:
        print("x" * 100000)
    """
    package = write_package(tmp_path, code)
    child_file = package / "child"
    with pytest.raises(SetupRunError, match=r"did not end within 0\.5 s"):
        run_setup_py(package, "it must")
    child = int(child_file.read_text())
    # A killed process exists until it has run once more.
    wait_until(lambda: not is_alive(child))


def test_setup_py_output_stdin_and_children_do_not_disturb_its_result(tmp_path: Path) -> None:
    """setup.py reads no input, its output is ignored, and child processes that keep running cause no delay."""
    code = """
    import atexit, os, subprocess, sys
    from setuptools import Extension, find_packages, setup
    from setuptools.command.build_py import build_py
    print("not the result", sys.stdin.read(), __name__, os.path.basename(__file__), sys.argv)
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    atexit.register(lambda: open("at_exit", "w"))
    class Build(build_py):
        pass
    setup(name="foo", packages=find_packages(), data_files=(row for row in [("share/foo", {"setup.py"})]),
          cmdclass={"build_py": Build}, ext_modules=[Extension("a", ["a.c"])])
    """
    package = write_package(tmp_path, code)
    started_at = time.monotonic()
    found = SetupArguments.of_calls(run_setup_py(package, "it must"))
    assert time.monotonic() - started_at < setup_process.TIMEOUT_S
    assert found.values["data_files"] == [["share/foo", ["setup.py"]]]
    assert found.values["packages"] == ["foo"]
    assert found.uncertain == {"data_files": "the command build_py of cmdclass"}
    assert not (package / "at_exit").exists()


@pytest.mark.parametrize("has_distutils", [True, False])
def test_setup_py_runs_without_setuptools(has_distutils: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    venv.create(tmp_path / "other", with_pip=False)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "other/bin/python"))
    if not has_distutils:
        write(tmp_path / "path", {"distutils.py": "raise ImportError('missing')"})
    monkeypatch.setenv("PYTHONPATH", "" if has_distutils else str(tmp_path / "path"))
    code = """
    import setuptools, distutils.core
    from setuptools import Command, Extension, find_namespace_packages, find_packages
    from setuptools.command.install import install
    from setuptools.command.test import test as TestCommand
    from pkg_resources import parse_version
    class Test(TestCommand):
        user_options = []
        def finalize_options(self):
            TestCommand.finalize_options(self)
    (setuptools if NAME == "setuptools" else distutils.core).setup(
        name="foo", packages=find_packages(exclude=["test*"]), py_modules=find_namespace_packages(include=["par*"]),
        cmdclass={"test": Test}, version=setuptools.__version__)
    """
    for name in ("setuptools", "distutils"):
        package = write_package(tmp_path / name, textwrap.dedent(code).replace("NAME", repr(name)))
        found = SetupArguments.of_calls(run_setup_py(package, "it must"))
        assert found.values["packages"] == ["foo"] and found.values["py_modules"] == ["params"]
        assert found.uncertain == {}


def test_python_modules_installed_as_data_files_are_importable(tmp_path: Path) -> None:
    setup = """
    import sys
    from setuptools import setup
    setup(name="foo", packages=["foo"], data_files=[
        ("lib/python%d.%d/site-packages" % sys.version_info[:2], ["extra/computed.py"]),
        ("lib/python3.6/site-packages/of_other", ["extra/__init__.py"]),
        ("lib/python3/dist-packages/foo/inner", ["extra/computed.py"]),
    ])
    """
    package = write_package(tmp_path, setup)
    write(package, {"extra/computed.py": "A = 1", "extra/__init__.py": "B = 2"})
    write(
        tmp_path / "ws", {"program.py": "import computed, of_other, foo\nprint(computed.A, of_other.B, foo.__file__)"}
    )
    assert run("src/foo/../../program.py", "--path", cwd=tmp_path / "ws").returncode == 0
    write(package, {"program.py": "import computed, of_other, foo\nprint(computed.A, of_other.B, foo.__file__)"})
    found = run("program.py", cwd=package)
    assert found.stdout == f"1 2 {package / 'foo/__init__.py'}\n", found.stderr
    made = build_prefix([package], tmp_path / "out")
    assert made.problems == ()
    code = "import computed, of_other, foo.inner.computed, foo.n1; print(computed.A, foo.inner.computed.A)"
    assert started(sys.executable, "-c", code, **variables(made.folder)).stdout == "1 1\n"
    assert (made.folder / SITE_PACKAGES / "foo/n1.py").is_file()
    shutil.rmtree(made.folder)


def test_scripts_and_data_files_in_lib_are_executables(tmp_path: Path) -> None:
    setup = "from setuptools import setup\nsetup(packages=['foo'], data_files=[('lib/foo', ['extra/data.py'])], {})"
    more = {"scripts/bar.py": "#!/usr/bin/env python3\nprint('bar')", "extra/data.py": "#!/usr/bin/python3\nprint(1)"}
    for arguments, options in (("scripts=['scripts/bar.py']", ""), ("", "[options]\nscripts = scripts/bar.py\n")):
        package = write_package(tmp_path, setup.format(arguments), setup__cfg=SETUP_CFG.format("foo") + options)
        write(package, more)
        assert run("foo", "bar.py", cwd=package).stdout == "bar\n"
        assert run("foo", "data.py", cwd=package).stdout == "1\n"
        assert run("--list", "foo", cwd=package).stdout == "foo bar.py\nfoo data.py\n"
        made = build_prefix([package], tmp_path / "out", runs_setup=True)
        assert started(made.folder / "lib/foo/bar.py").stdout == "bar\n"


def test_executables_installed_into_bin_run_with_warning(tmp_path: Path) -> None:
    setup = (
        "from setuptools import setup\nsetup(packages=['foo'], entry_points={'console_scripts': ['n1 = foo.n1:main']})"
    )
    package = write_package(tmp_path, setup, setup__cfg="")
    warning = "warning: a build installs this executable of foo into bin, where ros2 run and launch do not find it; "
    warning += "setup.cfg needs [develop] script_dir=$base/lib/foo and [install] install_scripts=$base/lib/foo\n"
    found = run("foo", "n1", cwd=package)
    assert (found.stdout, found.stderr) == ("False\n", warning)
    made = build_prefix([package], tmp_path / "run", runs_setup=True)
    found = started(made.folder / "lib/foo/n1", **variables(made.folder))
    assert (found.stdout, found.stderr) == ("False\n", warning)
    made = build_prefix([package], tmp_path / "as colcon")
    assert not (made.folder / "lib/foo").exists()
    found = started(made.folder / "bin/n1", **variables(made.folder))
    assert (found.stdout, found.stderr) == ("False\n", "")


def test_setup_cfg_and_pyproject_supplement_setup_py(tmp_path: Path) -> None:
    options = """
    [options]
    packages = find:
    package_dir =
        =python
    [options.packages.find]
    where = python
    exclude = skipped
    [options.data_files]
    share/foo/config = params/*.yaml
    share/foo = package.xml, setup.py
    [options.entry_points]
    console_scripts =
        n1 = foo2.n1:main
    """
    project = """
    [project]
    name = "other"
    version = "2.0"
    scripts = { n2 = "foo2.n1:main" }
    [project.entry-points."a.group"]
    one = "foo2.n1:main"
    [tool.setuptools.data-files]
    "share/foo/never" = ["setup.py"]
    """
    cfg = SETUP_CFG.format("foo") + textwrap.dedent(options)
    package = write_package(tmp_path, "import setuptools\nsetuptools.setup()", setup__cfg=cfg)
    write(
        package,
        {"pyproject.toml": textwrap.dedent(project), "python/foo2/__init__.py": "", "python/skipped/__init__.py": ""},
    )
    made = build_prefix([package], tmp_path / "out")
    assert made.problems == made.notes == ()
    share = made.folder / "share/foo"
    assert sorted(str(path.relative_to(share)) for path in share.rglob("*")) == [
        *("config", "config/a.yaml", "package.xml", "setup.py"),
    ]
    assert sorted(os.listdir(made.folder / "lib/foo")) == ["n1", "n2"]
    site = made.folder / SITE_PACKAGES
    assert os.readlink(site / "foo2") == str(package / "python/foo2") and not (site / "skipped").exists()
    assert "a.group" in (site / "other-2.0.dist-info/entry_points.txt").read_text()
