"""Settings of a project: the search path of its pyproject.toml, and generated packages of the current folder."""

from __future__ import annotations

import json
import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from support.interface_packages import run, write

from rosidl_py_gen import generator_cli, get_message, ros_cli
from rosidl_py_gen.base.project import GeneratedPackages, with_project_path
from rosidl_py_gen.errors import DefinitionError

TABLE = "[tool.rosidl-py]\n"


def test_nearest_pyproject_table_sets_folders_relative_to_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = {
        "pyproject.toml": f'{TABLE}path = ["src", "more/packages"]\n',
        "other/pyproject.toml": "[tool.other]\nx = 1\n",  # of another tool: looked for further up
        "other/broken/pyproject.toml": "[[[",  # does not name us
        "own/pyproject.toml": f'{TABLE}path = "here"\n',
        "empty/pyproject.toml": TABLE,
    }
    folders = ("src", "more/packages", "own/here", "deep/er")
    write(tmp_path, {**files, **{f"{name}/x": "" for name in folders}})
    os.mkfifo(tmp_path / "deep/er/pyproject.toml")  # no regular file: not opened, which would wait for a writer
    for place, expected in {
        ".": ["src", "more/packages"],
        "deep/er": [str(tmp_path / "src"), str(tmp_path / "more/packages")],
        "other/broken": [str(tmp_path / "src"), str(tmp_path / "more/packages")],
        "own": ["here"],
        "empty": [],
    }.items():
        monkeypatch.chdir(tmp_path / place)
        assert with_project_path([]) == tuple(expected), place
    monkeypatch.chdir(tmp_path)
    assert with_project_path(["own", "./src/"]) == ("own", "./src/", "more/packages")  # no folder twice


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('paths = ["src"]', "[tool.rosidl-py]: unknown key 'paths'; did you mean \"path\"?"),
        ("verbose = true", "[tool.rosidl-py]: unknown key 'verbose'; expected path"),
        ("path = 3", "[tool.rosidl-py] path: expected a folder or a list of folders, got 3"),
        ('path = ["src", 3]', "[tool.rosidl-py] path: expected a folder or a list of folders, got ['src', 3]"),
        ('path = ["src", "nowhere"]', "[tool.rosidl-py] path: 'nowhere' is not a folder"),
        ('path = "a\\u0000b"', "[tool.rosidl-py] path: 'a\\x00b' is not a folder"),
        ("path = [", "is not valid TOML: "),
        ("x = " + "[" * 9000, "is not valid TOML: "),
    ],
)
def test_invalid_project_settings_are_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], text: str, problem: str
) -> None:
    monkeypatch.chdir(write(tmp_path, {"pyproject.toml": TABLE + text, "src/x": ""}))
    with pytest.raises(DefinitionError) as caught:
        with_project_path([])
    assert str(caught.value).startswith(f"pyproject.toml: {problem}")
    for command in (lambda: ros_cli.main(["interface", "list"]), lambda: generator_cli.main(["--list"])):
        with pytest.raises(SystemExit) as end:
            command()
        assert (end.value.code, "Traceback" in capsys.readouterr().err) == (1, False)


def test_project_settings_that_are_not_a_table_are_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(write(tmp_path, {"pyproject.toml": "[tool]\nrosidl-py = 1\n"}))
    with pytest.raises(DefinitionError, match=r"tool\.rosidl-py: expected a table, got 1"):
        with_project_path([])


def test_both_command_lines_search_the_folders_of_the_project(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    definition = {"src/project_msgs/msg/A.msg": "uint8 x", "pyproject.toml": f'{TABLE}path = ["src"]\n', "deep/x": ""}
    program = {
        "src/robot/package.xml": "<package><name>robot</name></package>",
        "src/robot/setup.py": 'setup(entry_points={"console_scripts": ["talker = robot.talker:main"]})',
    }
    monkeypatch.chdir(write(tmp_path, {**definition, **program}) / "deep")
    ros_cli.main(["interface", "show", "project_msgs/msg/A"])
    assert capsys.readouterr().out == "uint8 x\n"
    ros_cli.main(["interface", "show", "project_msgs/msg/A", "--path", "../src"])
    assert capsys.readouterr().out == "uint8 x\n"
    generator_cli.main(["check", "project_msgs"])
    assert "1 interface in 1 package" in capsys.readouterr().out
    ros_cli.main(["run", "--list", "robot"])
    assert "talker" in capsys.readouterr().out


def test_commands_find_generated_packages_in_the_current_folder_and_on_pythonpath(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in ("here", "there"):
        files = {
            f"{place}_msgs/msg/A.msg": "uint8 X=1 # one\nuint8 x 3",
            f"{place}_msgs/srv/Ask.srv": "A a\n---\nstring<=4 s",
        }
        run(write(tmp_path / f"in_{place}", files), tmp_path / place)
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.syspath_prepend(tmp_path / "there")
    before = [*sys.path], [*sys.meta_path]
    write(tmp_path / "here", {"optional_library.py": "raise SystemExit('code of the current folder ran')"})
    with GeneratedPackages.of_current_folder():
        assert find_spec("optional_library") is None and find_spec("here_msgs") is not None
    for package, folder in (("here_msgs", "here_msgs"), ("there_msgs", str(tmp_path / "there/there_msgs"))):
        ros_cli.main(["interface", "show", f"{package}/Ask"])
        shown = capsys.readouterr()
        assert shown.out == f"{package}/A a\n\tuint8 x 3\n---\nstring<=4 s\n"
        note = f"this is its generated class in {folder}/srv/_ask.py, without comments and constants"
        assert note.replace("/", os.sep) in shown.err
        ros_cli.main(["interface", "hash", f"{package}/msg/A"])
        hashed = capsys.readouterr().out.split()[0]
        generator_cli.main(["interface", f"{package}/msg/A"])
        assert capsys.readouterr().out == f"# {package}/msg/A  {hashed}\nuint8 x 3\n"
        ros_cli.main(["interface", "proto", f"{package}/msg/A", "--path", str(tmp_path / "in_here" / "here_msgs")])
        assert capsys.readouterr().out == '"{x: 3}"\n'
        ros_cli.main(["interface", "package", package])
        assert capsys.readouterr().out == f"{package}/msg/A\n{package}/srv/Ask\n"
    ros_cli.main(["interface", "packages", "--json"])
    assert {"name": "here_msgs", "origin": "generated"} in json.loads(capsys.readouterr().out)
    assert (sys.path, sys.meta_path) == before
    assert get_message("there_msgs/msg/A", path=tmp_path / "in_here")().x == 3
