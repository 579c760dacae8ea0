"""``rosidl-py prefix``: creates the install prefix of colcon without a build, and writes only into its folder."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.interface_packages import write
from support.prefix_workspace import RECORDED, answers, listing, write_workspace
from support.program_processes import started

from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.prefix import build, executables, package_plan
from rosidl_py_gen.prefix.build import build_prefix
from rosidl_py_gen.prefix.environment import SITE_PACKAGES, variables

MANIFEST = "<package><name>{}</name><version>1.0.0</version></package>"
COMMAND = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "prefix"]

pytestmark = pytest.mark.real_time("programs are processes")


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("workspace")
    write_workspace(folder / "src")
    return folder


@pytest.fixture(scope="module")
def made(workspace: Path) -> build.Prefix:
    return build_prefix([workspace], workspace / ".ros")


def tree(folder: Path) -> dict[str, str | bytes]:
    """Return the files and links below a folder."""
    found: dict[str, str | bytes] = {}
    for place, folders, names in os.walk(folder):
        for name in (*names, *folders):
            path = Path(place, name)
            if path.is_symlink():
                found[str(path.relative_to(folder))] = os.readlink(path)
            elif path.is_file():
                found[str(path.relative_to(folder))] = path.read_bytes()
    return found


# --- a whole workspace ------------------------------------------------------------------------------------------------


def test_prefix_has_same_files_as_colcon(made: build.Prefix) -> None:
    recorded = json.loads(RECORDED.read_text())
    del recorded["ament_index_python"]
    assert listing(made.folder) == recorded
    assert not made.problems and not made.skipped


@pytest.mark.parametrize("option", ["-o", "--output", "--out"])
def test_three_spellings_of_the_folder_of_a_prefix(workspace: Path, tmp_path: Path, option: str) -> None:
    done = subprocess.run([*COMMAND, "src", option, str(tmp_path / "made")], cwd=workspace, check=False)
    assert done.returncode == 0 and (tmp_path / "made/setup.bash").is_file()


def test_ament_index_python_returns_recorded_results_for_prefix(made: build.Prefix) -> None:
    recorded = json.loads(RECORDED.read_text())["ament_index_python"]
    assert answers(sys.executable, made.folder, {**os.environ, **variables(made.folder)}) == recorded


@pytest.mark.parametrize(
    ("command", "output"),
    [
        ("lib/py_plain/talk", "talk"),
        ("lib/py_plain/py-listen", "listen"),
        ("lib/py_plain/py_script", "script"),
        ("lib/py_plain/py_data_script", "data 2"),
        ("bin/py_source_tool", "talk"),
        ("lib/cmake_all/node.py", "node ['--ros-args', '-r', 'a:=b']"),
        ("lib/cmake_all/node_renamed", "node ['--ros-args', '-r', 'a:=b']"),
        ("lib/cmake_all/shell.sh", "shell"),
    ],
)
def test_executables_of_prefix_run(command: str, output: str, made: build.Prefix) -> None:
    done = started(made.folder / command, "--ros-args", "-r", "a:=b", **variables(made.folder))
    assert (done.stdout.strip(), done.stderr, done.returncode) == (output, "", 0)


PROBE = """
import os, sys, importlib.metadata
import rclpy, some_msgs.msg, cmake_all, py_plain.node, tf2_ros
from some_msgs.srv import Ask
from std_msgs.msg import String
from rclpy.serialization import deserialize_message, serialize_message
message = some_msgs.msg.Plain(value=3)
assert deserialize_message(serialize_message(message), some_msgs.msg.Plain) == message
[entry] = importlib.metadata.entry_points(group="py_plain.plugins")
assert entry.load() is py_plain.node.Node
print(os.environ["ROS_DISTRO"], os.environ["ROS_VERSION"], os.environ["AMENT_PREFIX_PATH"].count(".ros"))
print(os.environ["PYTHONPATH"].count(".ros"), os.environ["PATH"].split(":")[0][-8:])
"""


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "sh"])
def test_sourced_shell_finds_packages_messages_and_entry_points(shell: str, made: build.Prefix, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    (tmp_path / "probe.py").write_text(PROBE)
    (tmp_path / "test_probe.py").write_text("import rclpy\nfrom some_msgs.msg import Plain\n\ndef test_it(): Plain()\n")
    script = f". {made.folder}/setup.{shell}\n" * 2 + f"'{sys.executable}' probe.py && '{sys.executable}' -m pytest -q"
    done = started(shell, "-c", script, cwd=tmp_path, PYTEST_ADDOPTS="-p no:cacheprovider")
    assert done.stdout.splitlines()[:2] == ["jazzy 2 1", "1 .ros/bin"], done.stderr
    assert "1 passed" in done.stdout and done.returncode == 0


def test_rebuilding_prefix_updates_only_changed_files(tmp_path: Path) -> None:
    write_workspace(tmp_path / "src")
    out = tmp_path / "out"
    build_prefix([tmp_path / "src"], out)
    before = {path: os.lstat(out / path).st_mtime_ns for path in tree(out)}
    assert (build_prefix([tmp_path], out).created, {path: os.lstat(out / path).st_mtime_ns for path in tree(out)}) == (
        *(0, before),
    )
    (tmp_path / "src/cmake_all/worlds/new.world").write_text("")
    (tmp_path / "src/cmake_all/launch/deep/b.launch.yaml").unlink()
    (out / "share/cmake_all/of the user").write_text("stays")
    made = build_prefix([tmp_path], out)
    assert (made.created, made.removed) == (1, 1)
    assert (out / "share/cmake_all/worlds/new.world").is_file()
    assert not (out / "share/cmake_all/launch/deep").exists()
    shutil.rmtree(tmp_path / "src/cmake_all")
    assert build_prefix([tmp_path], out).removed > 10
    assert tree(out)["share/cmake_all/of the user"] == b"stays"
    assert not (out / "lib/cmake_all").exists()


@pytest.mark.slow
def test_prefix_command_reports_result_and_errors(tmp_path: Path) -> None:
    write_workspace(tmp_path / "ws/src")
    more = {
        "cpp/package.xml": MANIFEST.format("cpp"),
        "cpp/CMakeLists.txt": """
            project(cpp)
            add_library(part SHARED a.cpp)
            add_executable(talker a.cpp)
            add_executable(not_installed a.cpp)
            install(TARGETS talker part DESTINATION lib/${PROJECT_NAME})
            install(DIRECTORY launch DESTINATION share/${PROJECT_NAME})
        """,
        "cpp/launch/a.launch.py": "",
    }
    write(tmp_path / "ws/src", more)
    done = started(*COMMAND, cwd=tmp_path / "ws/src/cpp")
    assert done.returncode == 0 and done.stderr == ""
    first, *rest = done.stdout.splitlines()
    assert first.startswith(".ros: 6 packages, ")
    assert rest == ["C++ code is not built:", "  cpp: without talker; with 1 launch file, 1 share file"]
    again = started(*COMMAND, cwd=tmp_path / "ws/src/cpp")
    assert again.stdout == ".ros: 6 packages, up to date\n"
    document = json.loads(started(*COMMAND, "src", "--out", "new", "--json", cwd=tmp_path / "ws").stdout)
    assert document["skipped"][0]["executables"] == ["talker"] and document["created"] > 40
    for arguments, text in (
        (["nothing"], "error: nothing: expected a folder of packages, found none"),
        (["src/cpp/launch"], "error: src/cpp/launch: expected packages with a package.xml, found none"),
        (["src", "--out", "src"], "error: src: the folder is not empty, and rosidl-py prefix has not written it"),
        (["src", "--out", "a:b"], 'b: a prefix must not have ":" in its path, which separates folders'),
        (["src", "--out", "src/cpp/package.xml/x"], "cannot be written: Not a directory"),
    ):
        failed = started(*COMMAND, *arguments, cwd=tmp_path / "ws")
        assert text in failed.stderr and failed.returncode == 1 and len(failed.stderr.splitlines()) == 1
    assert started(*COMMAND, cwd=tmp_path).returncode == 0  # ws is found: a workspace below the current folder


def test_prefix_without_out_option_is_in_cache(workspace: Path, tmp_path: Path) -> None:
    made = build_prefix([workspace / "src"])
    assert made.folder.is_relative_to(tmp_path / "cache/prefix")
    assert build_prefix([workspace / "src"]).created == 0
    assert build_prefix([workspace / "src/py_plain"]).folder != made.folder


def test_prefix_adds_bundled_executables_missing_in_workspace(
    workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(executables.BUNDLED, "py_plain", {"talk": "json:loads", "more": "platform:main"})
    made = build_prefix([workspace], tmp_path / "out")
    assert started(made.folder / "lib/py_plain/talk", **variables(made.folder)).stdout == "talk\n"
    assert (made.folder / "lib/py_plain/more").is_file()
    for package, names in executables.BUNDLED.items():
        assert all((made.folder / "lib" / package / name).is_file() for name in names)
        assert package == "py_plain" or all(map(find_spec, (one.partition(":")[0] for one in names.values())))


def test_bundled_executable_replaces_unbuilt_executable_of_same_name(tmp_path: Path) -> None:
    rules = "add_executable(static_transform_publisher a.cpp)\nadd_executable(other a.cpp)\n"
    rules += "install(TARGETS static_transform_publisher other DESTINATION lib/tf2_ros)"
    write(tmp_path / "tf2_ros", {"package.xml": MANIFEST.format("tf2_ros"), "CMakeLists.txt": rules})
    made = build_prefix([tmp_path / "tf2_ros"], tmp_path / "out")
    assert [one.missing for one in made.skipped] == [["other"]]
    assert (made.folder / "lib/tf2_ros/static_transform_publisher").is_file()


# --- Python -----------------------------------------------------------------------------------------------------------


def test_prefix_runs_other_sitecustomize_and_imports_no_package_early(made: build.Prefix, tmp_path: Path) -> None:
    write(tmp_path, {"more/sitecustomize.py": "print('next')"})
    environment = variables(made.folder)
    environment["PYTHONPATH"] += f"{os.pathsep}{tmp_path / 'more'}"
    code = "import sys; print([name for name in sys.modules if name.startswith('rosidl_py_gen')])"
    assert started(sys.executable, "-c", code, **environment).stdout == "next\n[]\n"


def test_rclpy_import_error_explains_python_without_rosidl_py_gen(made: build.Prefix) -> None:
    code = "import sys\nsys.modules['rosidl_py_gen'] = None\nimport rclpy"
    done = started(sys.executable, "-c", code, **variables(made.folder))
    text = "has no rosidl-py-gen, which provides rclpy; use the Python that has it"
    assert done.stderr.splitlines()[-1] == f"ModuleNotFoundError: {sys.executable} {text}"


def test_run_uses_its_own_settings_in_a_sourced_shell(made: build.Prefix, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text("from some_msgs.msg import Plain\nimport rclpy\nprint(Plain(value=1))\n")
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run", "program.py"]
    done = started(*command, cwd=tmp_path, **variables(made.folder))
    assert (done.stdout, done.stderr) == ("some_msgs.msg.Plain(value=1)\n", "")


def test_default_distribution_of_prefix_keeps_detection_of_humble(made: build.Prefix) -> None:
    code = "from rosidl_py_gen.base.distributions import Distribution; print(repr(Distribution.name_for_node()))"
    assert started(sys.executable, "-c", code, **variables(made.folder)).stdout == "''\n"
    chosen = {**variables(made.folder), "ROS_DISTRO": "humble"}
    assert started(sys.executable, "-c", code, **chosen).stdout == "None\n"


# --- rules that cannot be read ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "rules",
    [
        {"setup.py": "from setuptools import setup\nsetup(name='odd', data_files=files_of('launch'))"},
        {"setup.py": "from setuptools import setup\nsetup(name='odd', data_files=[(a(), ['launch/a.launch.py'])])"},
        {"CMakeLists.txt": "install(DIRECTORY ${UNKNOWN} DESTINATION share/odd)"},
        {"CMakeLists.txt": "add_subdirectory(launch)", "launch/CMakeLists.txt": "install(FILES a DESTINATION share)"},
        {},
    ],
    ids=["function", "place", "variable", "subdirectory", "nothing"],
)
def test_all_files_are_linked_if_install_rules_are_unreadable(rules: dict[str, str], tmp_path: Path) -> None:
    files = {"package.xml": MANIFEST.format("odd"), "launch/a.launch.py": "", "src/a.cpp": "", "include/a.hpp": ""}
    write(tmp_path / "odd", {**files, **rules})
    made = build_prefix([tmp_path / "odd"], tmp_path / "out")
    assert (made.folder / "share/odd/launch/a.launch.py").is_file()
    assert not (made.folder / "share/odd/src").exists() and not made.problems


def test_flattened_data_file_is_linked_only_once(tmp_path: Path) -> None:
    rows = "[('share/odd', ['launch/a.launch.py']), (f(), [])]"
    files = {"setup.py": f"setup(data_files={rows})", "package.xml": MANIFEST.format("odd"), "launch/a.launch.py": ""}
    write(tmp_path / "odd", files)
    build_prefix([tmp_path / "odd"], tmp_path / "out")
    assert sorted(tree(tmp_path / "out/share/odd")) == ["a.launch.py", "package.xml"]


def test_namespace_packages_are_linked(tmp_path: Path) -> None:
    setup = "setup(packages=find_namespace_packages(where='src', exclude=['skipped']), package_dir={'': 'src'})"
    files = {"setup.py": setup, "src/spaced/inner/a.py": "", "src/plain/__init__.py": "", "src/skipped/a.py": ""}
    write(tmp_path / "odd", {"package.xml": MANIFEST.format("odd"), **files})
    made = build_prefix([tmp_path / "odd"], tmp_path / "out")
    links = [path.name for path in (made.folder / SITE_PACKAGES).iterdir() if path.is_symlink()]
    assert sorted(links) == ["plain", "spaced"]


def test_large_program_without_executable_mode_is_reported_instead_of_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(package_plan, "MAX_COPY_BYTES", 20)
    rules = "install(PROGRAMS small large DESTINATION lib/odd)"
    files = {"CMakeLists.txt": rules, "small": "#!/bin/sh\necho 1\n", "large": "#!/bin/sh\n" + "#" * 20}
    write(tmp_path / "odd", {"package.xml": MANIFEST.format("odd"), **files})
    made = build_prefix([tmp_path / "odd"], tmp_path / "out")
    assert os.listdir(made.folder / "lib/odd") == ["small"]
    assert started(made.folder / "lib/odd/small").stdout == "1\n"
    assert len(made.problems) == 1 and made.problems[0].endswith("is not executable: chmod +x")


# --- damaged and hostile workspaces -----------------------------------------------------------------------------------

DAMAGED = {
    "syntax": ({"setup.py": "setup(name='odd'"}, "setup.py: '(' was never closed"),
    "nesting": ({"setup.py": "setup(" + "(" * 5000}, "setup.py: "),
    "setup.cfg": (
        {"setup.py": "setup()", "setup.cfg": "no section\n"},
        "setup.cfg: line 1: got 'no section'; expected a section",
    ),
    "entry point": (
        {"setup.py": "setup(entry_points={'console_scripts': ['a b']})"},
        'expected "name = module:function"',
    ),
    "entry points": (
        {"setup.py": "setup(entry_points=points())"},
        "not known without running it: points() in line 1",
    ),
    "executable": (
        {"setup.py": "setup(entry_points={'console_scripts': ['../../x = a:b']})"},
        '"bin/../../x" is not a path below the prefix',
    ),
    "absolute": (
        {"setup.py": "setup(data_files=[('/elsewhere', ['a.txt'])])"},
        '"/elsewhere/a.txt" is not a path below',
    ),
    "upwards": (
        {"setup.py": "setup(data_files=[('share/../../x', ['a.txt'])])"},
        '"../x/a.txt" is not a path',
    ),
    "source": (
        {"setup.py": "setup(data_files=[('share/odd', ['../a', '/etc/passwd'])])"},
        '"/etc/passwd" is not in the',
    ),
    "of the prefix": (
        {"setup.py": "setup(data_files=[('', ['setup.sh'])])", "setup.sh": "rm"},
        "setup.sh is a file of",
    ),
    "folder": (
        {"setup.py": "setup(data_files=[('share/odd', ['a.txt']), ('share/odd/a.txt', ['package.xml'])])"},
        "share/odd/a.txt/package.xml cannot be written: share/odd/a.txt is not a folder",
    ),
    "cmake": ({"CMakeLists.txt": "install(FILES a.txt DESTINATION ../../x)"}, '"../../x/a.txt" is not a path below'),
    "resource": (
        {"CMakeLists.txt": "ament_index_register_resource(../../../../../x)"},
        "is not a path below the prefix",
    ),
    "too large": ({"CMakeLists.txt": "#" * (2 << 20)}, "the file is longer than"),
    "name": ({"package.xml": MANIFEST.format("../../x")}, '"../../x" is not the name of a package'),
    "duplicate": ({"../other/package.xml": MANIFEST.format("odd")}, "two packages are called odd: "),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_damaged_packages_are_reported_and_others_are_complete(case: str, tmp_path: Path) -> None:
    files, text = DAMAGED[case]
    good = {
        "good/package.xml": MANIFEST.format("good"),
        "good/setup.py": "setup(py_modules=['good'])",
        "good/good.py": "",
    }
    write(tmp_path / "a/src", good)
    write(tmp_path / "a/src/odd", {"package.xml": MANIFEST.format("odd"), "a.txt": "", **files})
    before = tree(tmp_path)
    made = build_prefix([tmp_path / "a"], tmp_path / "a/b/out")
    assert text in " ".join(made.problems)
    after = tree(tmp_path)
    assert {path: after[path] for path in after if not path.startswith("a/b/out/")} == before
    assert (made.folder / SITE_PACKAGES / "good.py").is_file()
    assert b"AMENT_PREFIX_PATH" in (made.folder / "setup.sh").read_bytes()


def test_malformed_console_scripts_do_not_hide_valid_ones(tmp_path: Path) -> None:
    scripts = ["bad = odd.bad", "a b", "good = odd.good:main"]
    setup = f"setup(packages=['odd'], entry_points={{'console_scripts': {scripts}}})"
    files = {"setup.py": setup, "setup.cfg": "[install]\ninstall_scripts=$base/lib/odd\n", "odd/__init__.py": ""}
    write(tmp_path / "odd", {"package.xml": MANIFEST.format("odd"), **files})
    made = build_prefix([tmp_path / "odd"], tmp_path / "out")
    assert len(made.problems) == 2
    assert os.listdir(made.folder / "lib/odd") == ["good"]
    assert (made.folder / SITE_PACKAGES / "odd").is_symlink()
    found = next((made.folder / SITE_PACKAGES).glob("odd-*/entry_points.txt")).read_text()
    assert "good = odd.good:main" in found and "a b" not in found


def test_prefix_tolerates_link_loops_pipes_and_odd_file_names(tmp_path: Path) -> None:
    package = tmp_path / "odd"
    write(package, {"package.xml": MANIFEST.format("odd"), "launch/a.launch.py": ""})
    (package / "CMakeLists.txt").write_text("install(DIRECTORY launch . DESTINATION share/odd)")
    os.symlink(package, package / "launch/loop")
    os.symlink("itself", package / "launch/itself")
    os.mkfifo(package / "launch/pipe")
    Path(os.fsdecode(bytes(package / "launch") + b"/\xff\n.py")).write_text("")
    os.mkfifo(package / "setup.py")
    (tmp_path / "pipe").mkdir()
    os.mkfifo(tmp_path / "pipe/package.xml")
    os.mkfifo(tmp_path / "pipe/CMakeLists.txt")
    made = build_prefix([package, package, tmp_path / "pipe"], tmp_path / "out")
    names = os.listdir(made.folder / "share/odd/launch")
    assert {"a.launch.py", "loop"} <= {*names} and "pipe" not in names
    assert any("\\n" in problem or "\n" in problem for problem in made.problems)
    done = started(*COMMAND, package, "--out", tmp_path / "other")
    assert "Traceback" not in done.stderr and done.returncode == 1


def test_prefix_works_in_path_with_special_characters(tmp_path: Path) -> None:
    write_workspace(tmp_path / "src")
    out = tmp_path / 'it\'s $HOME `a` "b" \\ é'
    made = build_prefix([tmp_path / "src"], out)
    for shell in ("sh", "bash", "fish"):
        if shutil.which(shell):
            script = f'. "$OUT/setup.{shell}"; "{sys.executable}" -c "import rclpy, some_msgs.msg, py_plain"'
            done = started(shell, "-c", script, OUT=str(out))
            assert (done.stderr, done.returncode) == ("", 0)
    assert started(out / "lib/py_plain/talk", **variables(made.folder)).stdout == "talk\n"


def test_installed_files_of_a_package_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(package_plan, "MAX_FILES", 50)
    write(tmp_path / "odd", {"package.xml": MANIFEST.format("odd"), **{f"data/{n}": "" for n in range(60)}})
    (tmp_path / "odd/CMakeLists.txt").write_text("install(DIRECTORY data DESTINATION share/odd)")
    made = build_prefix([tmp_path / "odd"], tmp_path / "out")
    assert "it installs more than 50 files" in made.problems[0]


def test_manipulated_links_and_state_of_prefix_change_no_outside_files(workspace: Path, tmp_path: Path) -> None:
    outside, out = tmp_path / "outside", tmp_path / "out"
    write(outside, {"file": "stays"})
    build_prefix([workspace], out)
    shutil.rmtree(out / "share/py_plain")
    (out / "share/py_plain").symlink_to(outside)
    (out / "setup.sh").unlink()
    (out / "setup.sh").symlink_to(outside / "file")
    (out / build.STATE).write_text("../outside/file\nshare/py_plain/file\n1\n/x\nsetup.sh")
    made = build_prefix([workspace], out)
    assert tree(outside) == {"file": b"stays"}
    assert any("share/py_plain is not a folder" in problem for problem in made.problems)
    assert not (out / "setup.sh").is_symlink()
    (out / build.STATE).write_bytes(b"\xff[" * 10_000)
    assert build_prefix([workspace], out).problems
    (out / build.STATE).unlink()
    with pytest.raises(CommandError, match="has not written it"):
        build_prefix([workspace], out)


@pytest.mark.parametrize("mask", [0, 0o002, 0o022, 0o077, 0o777])
def test_prefix_folders_are_writable_by_owner_only_and_readable_by_umask(
    mask: int, workspace: Path, tmp_path: Path
) -> None:
    old = os.umask(mask)
    try:
        made = build_prefix([workspace], tmp_path / "new/out")
    finally:
        os.umask(old)
    assert made.problems == build_prefix([workspace], tmp_path / "new/out").problems and not made.unsafe
    modes = {one.stat().st_mode & 0o777 for one in made.folder.rglob("*") if one.is_dir() and not one.is_symlink()}
    assert modes == {0o700 if mask & 0o055 == 0o055 else 0o755}


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners and modes")
@pytest.mark.parametrize(
    "place", [".", "out", "out/lib", f"out/{SITE_PACKAGES}", f"out/{SITE_PACKAGES}/sitecustomize.py"]
)
def test_prefix_writable_by_other_users_is_a_warning(place: str, workspace: Path, tmp_path: Path) -> None:
    out = tmp_path / "open/out"
    assert build_prefix([workspace], out).unsafe == ""
    changed = tmp_path / "open" / place
    changed.chmod(0o777)
    found = started(*COMMAND, workspace, "--out", out)
    if changed.is_file():  # it is written again
        assert "warning" not in found.stderr
    else:
        text = f"warning: other users can write into {changed} (mode 0777): another user can run code as each user of"
        assert text in found.stderr and f"chmod -R go-w {out}" in found.stderr
    if changed.is_dir() and changed.name != "open":  # the sticky bit protects a folder in it, not its own entries
        changed.chmod(0o1777)
        assert f"into {changed} (mode 1777)" in build_prefix([workspace], out).unsafe
    if os.geteuid() == 0 and changed.is_dir():
        changed.chmod(0o755)
        os.chown(changed, 65534, 65534)
        assert f"{changed} belongs to user" in build_prefix([workspace], out).unsafe


@pytest.fixture(scope="module")
def hostile_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("hostile")
    write(folder / "src/odd", {"package.xml": MANIFEST.format("odd"), "a/b.txt": "", "odd/__init__.py": ""})
    yield folder


_PIECES = st.sampled_from(
    [*"ab/.$%'\" \n\\", "..", "share", "lib", "odd", "/", "~", "$base", "{}", "\udcff", "\ud800", "é", "*"]
)
_TEXTS = st.lists(_PIECES, max_size=6).map("".join)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.lists(_TEXTS, min_size=6, max_size=6), st.booleans())
def test_install_rules_never_write_outside_prefix(hostile_home: Path, texts: list[str], is_cmake: bool) -> None:
    package = hostile_home / "src/odd"
    for name in ("setup.py", "setup.cfg", "CMakeLists.txt"):
        (package / name).unlink(missing_ok=True)
    if is_cmake:
        lines = [
            f'install(DIRECTORY "{texts[0]}" a DESTINATION "{texts[1]}")',
            f"install(FILES a/b.txt DESTINATION {texts[2]})",
        ]
        lines += [
            f"ament_python_install_package({texts[3]} PACKAGE_DIR odd)",
            f"ament_index_register_resource({texts[4]})",
        ]
        lines += [f"install(PROGRAMS a/b.txt DESTINATION lib RENAME {texts[5]})"]
        (package / "CMakeLists.txt").write_bytes("\n".join(lines).encode(errors="replace"))
    else:
        points = {"console_scripts": [f"{texts[3]} = a:b"], texts[4]: [texts[5]]}
        rows = [(texts[0], ["a/b.txt", texts[1]])]
        arguments = {"scripts": [texts[2]], "packages": [texts[3]], "name": texts[5]}
        text = f"setup(data_files={rows!a}, entry_points={points!a}, **{arguments!a})"
        (package / "setup.py").write_text(text)
        (package / "setup.cfg").write_bytes(
            f"[install]\ninstall_scripts = {texts[1]}".replace("\r", "").encode(errors="replace")
        )
    before = tree(hostile_home / "src")
    made = build_prefix([hostile_home / "src"], hostile_home / "here/out")
    assert tree(hostile_home / "src") == before
    assert sorted(os.listdir(hostile_home)) == ["here", "src"] and os.listdir(hostile_home / "here") == ["out"]
    assert (made.folder / "share/odd/package.xml").is_file()


def test_concurrent_processes_build_one_prefix(workspace: Path, tmp_path: Path) -> None:
    command = [*COMMAND, str(workspace / "src"), "--out", str(tmp_path / "out")]
    processes = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    assert [(process.communicate(timeout=60)[1], process.returncode) for process in processes] == [("", 0)] * 3
    assert build_prefix([workspace / "src"], tmp_path / "out").created == 0
