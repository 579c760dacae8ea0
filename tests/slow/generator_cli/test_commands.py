"""The command line as users and scripts see it: output, files, exit codes."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.generator_shell import Shell
from support.interface_packages import write

WORLD = {
    "a_msgs/msg/Point.msg": "# A place.\n\nfloat64 x # [m]\nfloat64 y\n",
    "a_msgs/msg/Named.msg": "string name\nPoint place\n",
    "b_msgs/srv/Ask.srv": "a_msgs/Named who\n---\n",
}


@pytest.fixture
def world(tmp_path: Path) -> str:
    return str(write(tmp_path / "src", WORLD))


# --- generate ---------------------------------------------------------------------------------------------------------


def test_filter_generates_importable_packages_with_dependencies(shell: Shell) -> None:
    answer = shell("--filter", "std_msgs:geometry_msgs")
    assert answer.code == 0
    packages = {name.split("/")[0] for name in shell.written()}
    assert packages == {"builtin_interfaces", "geometry_msgs", "std_msgs"}
    code = "from std_msgs.msg import String; print(String(data='hello').encode().hex())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=shell.folder)
    assert done.stdout == "000100000600000068656c6c6f00\n"


@pytest.mark.parametrize(
    "selection", ["a_msgs;b_msgs", "b_msgs", "b_msgs:a_msgs", "a_msgs,b_msgs", " b_msgs ; ; ", "b_msgs/srv/Ask:a_msgs"]
)
def test_filter_includes_dependencies(shell: Shell, world: str, selection: str) -> None:
    assert shell("--path", world, "--filter", selection).code == 0
    packages = {name.split("/")[0] for name in shell.written()}
    assert packages == {"a_msgs", "b_msgs", "builtin_interfaces", "service_msgs"}


def test_filter_can_be_set_by_environment_variable(shell: Shell, world: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IDL_PACKAGE_FILTER", "a_msgs")
    assert shell("--path", world).code == 0
    assert {name.split("/")[0] for name in shell.written()} == {"a_msgs"}
    assert shell("--path", world, "--filter", "b_msgs").code == 0  # the option wins
    assert "b_msgs/srv/_ask.py" in shell.written()
    assert "2 interfaces in 1 package: no problems" in shell("check", "--path", world).out


def test_single_interface_is_generated_and_unchanged_on_repetition(shell: Shell, world: str) -> None:
    command = ("--path", world, "--filter", "a_msgs/msg/Point", "--json")
    first, second = shell(*command).json, shell(*command).json
    assert (first["interfaces"], len(first["written"]), first["removed"]) == (["a_msgs/msg/Point"], 4, [])
    assert (second["written"], second["unchanged"]) == ([], 4)
    assert shell.written() == [
        f"a_msgs/{name}" for name in ("__init__.py", "msg/__init__.py", "msg/_point.py", "py.typed")
    ]


def test_check_option_lists_pending_changes_and_writes_no_files(shell: Shell, world: str) -> None:
    command = ("--path", world, "--filter", "a_msgs")
    answer = shell(*command, "--check")
    assert (answer.code, shell.written()) == (1, [])
    assert f"would write {Path('a_msgs/msg/_point.py')}" in answer.out
    assert shell(*command).code == 0
    assert shell(*command, "--check").code == 0
    (shell.folder / "a_msgs" / "msg" / "_point.py").unlink()
    assert shell(*command, "--check").code == 1
    assert "a_msgs/msg/_point.py" not in shell.written()


# --- list -------------------------------------------------------------------------------------------------------------


def test_list_option_prints_packages_with_origin(shell: Shell, world: str) -> None:
    answer = shell("--path", world, "--list")
    lines = {line.split()[0]: line for line in answer.out.splitlines()}
    assert str(Path(world) / "a_msgs") in lines["a_msgs"]
    assert "bundled" in lines["sensor_msgs"]
    assert shell.written() == []


# --- errors -----------------------------------------------------------------------------------------------------------


def test_definition_errors_have_line_and_caret_and_no_files_are_written(shell: Shell, tmp_path: Path) -> None:
    files = {"a_msgs/msg/Bad.msg": "uint8 fine\nfloat64 Wrong 3\n", "a_msgs/msg/Worse.msg": "std_msgs/Heder header\n"}
    folder = write(shell.folder / "src", files)
    before = shell.written()
    answer = shell("--path", str(folder), "--filter", "a_msgs")
    assert (answer.code, answer.out, shell.written()) == (1, "", before)
    assert answer.err.splitlines() == [
        'error: src/a_msgs/msg/Bad.msg:2:9: "Wrong" is not a field name; expected lower case letters, digits and '
        "single underscores, a letter first, no underscore last",
        "    float64 Wrong 3",
        "            ^",
        'error: src/a_msgs/msg/Worse.msg:1:1: unknown type "std_msgs/Heder"; did you mean "std_msgs/Header"?',
        "    std_msgs/Heder header",
        "    ^",
        "2 problems; nothing was written (--keep-going generates the valid interfaces)",
    ]
    rows = shell("--path", str(folder), "--filter", "a_msgs", "--json").json["errors"]
    assert [(row["path"], row["line"], row["column"]) for row in rows] == [
        ("src/a_msgs/msg/Bad.msg", 2, 9),
        ("src/a_msgs/msg/Worse.msg", 1, 1),
    ]
    for command in (("--path", "src", "check"), ("--json", "check", "--path", "src")):  # options of the group
        answer = shell(*command, "a_msgs")
        assert answer.code == 1 and "Wrong" in answer.out + answer.err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--filter", "std_msg"), 'std_msg: no package; did you mean "std_msgs"? (searched: bundled)'),
        (
            ("--filter", "std_msgs/msg/Strin"),
            'std_msgs/msg/Strin: no interface of this name; did you mean "std_msgs/msg/String"?',
        ),
        (("--filter", "a/b/c/d"), '"a/b/c/d" is not an interface name'),
        (("--path", "nowhere", "--list"), "nowhere: expected a folder with interface packages, found none"),
        (("interface", "std_msgs/msg/Nothing"), "no interface std_msgs/msg/Nothing; did you mean"),
        (("check", "nothing_msgs"), "nothing_msgs: no package"),
    ],
)
def test_invalid_names_and_paths_are_reported_without_traceback(
    shell: Shell, arguments: tuple[str, ...], text: str
) -> None:
    answer = shell(*arguments)
    assert answer.code == 1
    assert text in answer.err
    assert "Traceback" not in answer.err
    assert shell.written() == []


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--nonsense",), "error: rosidl-py-gen: no option --nonsense\nhint: expected `rosidl-py-gen "),
        (("interface",), "error: rosidl-py-gen interface: missing NAME\n"),
        (("std_msgs",), "--filter std_msgs"),
        (("--path",), "error: --path requires an argument\n"),
        (("--out", "x", "interface", "std_msgs/msg/String"), "--out has no meaning for the command interface"),
        (("--check", "interface", "std_msgs/msg/String"), "--check has no meaning for the command interface"),
        (("--list", "interface", "std_msgs/msg/String"), "--list has no meaning for the command interface"),
        (("--filter", "a", "interface", "std_msgs/msg/String"), "--filter has no meaning for the command interface"),
        (("--keep-going", "check"), "--keep-going has no meaning for the command check"),
    ],
)
def test_invalid_command_line_exits_with_2(shell: Shell, arguments: tuple[str, ...], text: str) -> None:
    answer = shell(*arguments)
    assert (answer.code, text in answer.err, "Traceback" in answer.err) == (2, True, False), answer.err


def test_without_a_selection_the_help_is_printed(shell: Shell) -> None:
    for arguments in ((), ("--json",), ("--keep-going",)):
        answer = shell(*arguments)
        assert (answer.code, answer.out, shell.written()) == (2, "", [])
        assert answer.err == shell("--help").out
    assert (len(shell("--list").out.splitlines()), len(shell("--list", "--json").json)) == (26, 26)
    answer = shell("--check")
    assert (answer.code, "files would be written" in answer.out, shell.written()) == (1, True, [])


@pytest.mark.parametrize("arguments", [("--out", "."), ("--filter", "")])
def test_all_packages_are_generated_on_request(shell: Shell, arguments: tuple[str, ...]) -> None:
    assert shell(*arguments).code == 0
    assert len([path for path in shell.folder.iterdir() if path.is_dir()]) == 26


def test_generating_all_packages_removes_packages_without_definitions(shell: Shell, world: str) -> None:
    assert shell("--path", world).code == 0
    shutil.rmtree(Path(world) / "b_msgs")
    assert shell("--path", world).code == 0
    assert (Path("b_msgs").exists(), Path("a_msgs/msg/_point.py").exists()) == (False, True)


def test_generated_files_below_the_path_are_not_a_package(shell: Shell) -> None:
    listing = "find_package(rosidl_default_generators)\nfile(GLOB files RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} msg/*)\n"
    listing += "rosidl_generate_interfaces(robot_msgs ${files})\n"
    package = "<package><name>robot_msgs</name></package>"
    files = {"package.xml": package, "CMakeLists.txt": listing, "msg/A.msg": "int8 x"}
    write(shell.folder / "src/robot_msgs", files)
    for out in ("generated", "generated", "src", "src"):  # next to the definitions, and among them
        answer = shell("--path", ".", "--filter", "robot_msgs", "--out", out)
        assert (answer.code, answer.out[:25]) == (0, "1 interface in 1 package:"), answer.err


@pytest.mark.parametrize("option", ["-o", "--output", "--out"])
@pytest.mark.parametrize(
    ("words", "made"),
    [(("--filter", "std_srvs"), "std_srvs/srv/_trigger.py"), (("wheel", "std_srvs"), "std_srvs-*.whl")],
)
def test_three_spellings_of_the_output_folder(shell: Shell, option: str, words: tuple[str, ...], made: str) -> None:
    answer = shell(*words, option, "made")
    assert answer.code == 0, answer.err
    assert [*(shell.folder / "made").glob(made)]


# --- the other commands -----------------------------------------------------------------------------------------------


def test_check_command_validates_definitions_and_writes_no_files(shell: Shell, world: str, tmp_path: Path) -> None:
    assert shell("check", "a_msgs", "--path", world).code == 0
    assert shell("check", "--path", world).code == 0
    bad = write(tmp_path / "bad", {"bad_msgs/msg/A.msg": "int x"})
    answer = shell("check", "--path", str(bad), "bad_msgs")
    assert answer.code == 1
    assert 'A.msg:1:1: "int" is neither' in answer.err
    assert shell.written() == []


def test_interface_prints_the_definition_and_its_hash(shell: Shell, world: str) -> None:
    answer = shell("interface", "a_msgs/msg/Point", "--path", world)
    assert answer.code == 0
    assert "float64 x # [m]" in answer.out
    assert "RIHS01_" in shell("interface", "std_srvs/srv/SetBool_Request").out
    description = shell("interface", "std_msgs/msg/String", "--json").json
    assert "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18" in json.dumps(description)


# --- quick and quiet --------------------------------------------------------------------------------------------------


def process(*arguments: str, code: str = "") -> subprocess.CompletedProcess[str]:
    tail = "; import atexit" + code if code else ""
    program = f"import sys{tail}\nfrom rosidl_py_gen.generator_cli import main\nmain({list(arguments)!r})"
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)


def test_help_loads_no_heavy_modules() -> None:
    done = process("--help", code="\natexit.register(lambda: print(*sys.modules))")
    assert done.returncode == 0 and "--filter" in done.stdout
    modules = set(done.stdout.split())
    assert "rosidl_py_gen.generator_cli" in modules
    assert not {"numpy", "jinja2", "lark", "cyclonedds", "yaml", "rosidl_py_gen.compiler.generate"} & modules


def test_output_to_pipe_has_no_colour_and_no_progress_bar(tmp_path: Path) -> None:
    done = process("--list")
    assert "\x1b" not in done.stdout + done.stderr
    assert process("--out", str(tmp_path)).stderr == ""


def test_control_characters_of_definitions_are_not_printed(shell: Shell) -> None:
    hostile = "\x1b]0;title\x07\x9b2J\u202e"
    texts = {"ws": f"# {hostile}\r\nstring s\n", "new": f"# {hostile}\r\nstring s 'x{hostile}'\n"}
    for folder, text in texts.items():
        write(shell.folder / folder, {"a_msgs/package.xml": "<package/>", "a_msgs/msg/A.msg": text})
    commands = [
        ("interface", "a_msgs/msg/A", "--path", "ws"),
        ("interface", "a_msgs/msg/A", "--path", "ws", "--full"),
        ("interface", "a_msgs/msg/A", "--path", "new", "--json"),
        ("diff", "ws", "new"),
        ("diff", "ws", "new", "--json"),
        ("diff", "ws", f"git:{hostile}"),
        ("--filter", hostile, "--path", "ws"),
        (hostile,),
    ]
    for command in commands:
        answer = shell(*command)
        shown = answer.out + answer.err
        assert shown and shown.replace("\n", "").isprintable(), command
    assert shell(*commands[0]).out.splitlines()[1:] == ["# \ufffd]0;title\ufffd\ufffd2J\ufffd", "string s"]
