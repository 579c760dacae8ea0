"""Errors of the command line, examples in the help of groups, and the line ``next:``."""

from __future__ import annotations

import re
import shlex
import sys
from typing import TYPE_CHECKING, Any

import click
import pytest

from rosidl_py_gen import generator_cli, ros_cli
from rosidl_py_gen.base.terminal_text import print_next_step
from rosidl_py_gen.ros_cli.groups import COMMANDS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    RunHere = Callable[..., tuple[int, str, str]]

GROUPS = [name for name, (_, modules) in COMMANDS.items() if isinstance(modules, dict)]
ECHO = "hint: expected `rosidl-py topic echo [OPTIONS] TOPIC [TYPE]`; --help explains it"


@pytest.mark.parametrize(
    ("words", "error", "hint"),
    [
        ("topic echo", "rosidl-py topic echo: missing TOPIC", ECHO),
        ("topic echo /x --nope", 'rosidl-py topic echo: no option --nope; did you mean "--once"?', ECHO),
        ("topic echo /a b c d", "rosidl-py topic echo: unexpected arguments c d", ECHO),
        ("topic echo /a b c", "rosidl-py topic echo: unexpected argument c", ECHO),
        ("topic echo /a --domain 300", "rosidl-py topic echo: --domain: 300 is not in the range 0<=x<=232", ECHO),
        ("topic echo --domain", "--domain requires an argument", ""),
        (
            "topic ech",
            'rosidl-py topic: no command "ech"; did you mean "echo"?',
            "hint: expected one of bw, delay, echo",
        ),
        (
            "completion",
            "rosidl-py completion: missing SHELL; expected one of bash, zsh, fish",
            "hint: expected `rosidl",
        ),
        ("wtf", 'rosidl-py: no command "wtf"', "hint: `rosidl-py doctor` checks the installation and the network"),
        (
            "daemon status",
            'rosidl-py: no command "daemon"',
            "hint: there is no daemon, because each command discovers ",
        ),
    ],
)
def test_wrong_command_line_prints_one_error_line_and_its_hint(
    words: str, error: str, hint: str, run_here: RunHere
) -> None:
    code, out, err = run_here(*words.split())
    first, *others = err.splitlines()
    assert (code, out, first) == (2, "", f"error: {error}")
    assert len(others) == bool(hint) and "".join(others).startswith(hint)


@pytest.mark.parametrize(
    ("words", "code", "error"),
    [
        (["bag", "info", "nowhere"], 1, "error: nowhere: file does not exist\n"),
        (
            ["interface", "show", "std_msgs/msg/Strin"],
            1,
            "error: no interface std_msgs/msg/Strin; did you mean ",
        ),
        (["interface", "show", "--path", ".", "my_msgs/msg/Bad"], 1, "error: my_msgs/msg/Bad.msg:1:1: unknown type "),
    ],
)
def test_errors_of_both_programs_begin_with_the_same_prefix(
    words: list[str], code: int, error: str, run_here: RunHere, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_msgs/msg").mkdir(parents=True)
    (tmp_path / "my_msgs/package.xml").write_text("<package><name>my_msgs</name></package>")
    (tmp_path / "my_msgs/msg/Bad.msg").write_text("Nothing x\n")
    monkeypatch.chdir(tmp_path)
    found, _, err = run_here(*words)
    assert found == code and err.startswith(error), err


def generate(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[object, str, str]:
    try:
        generator_cli.main([*words])
    except SystemExit as end:
        return (end.code, *capsys.readouterr())
    return (0, *capsys.readouterr())


def test_generator_has_the_same_form_of_errors(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_msgs/msg").mkdir(parents=True)
    (tmp_path / "my_msgs/package.xml").write_text("<package><name>my_msgs</name></package>")
    (tmp_path / "my_msgs/msg/Bad.msg").write_text("Nothing x\n")
    code, out, err = generate(capsys, "check", "my_msgs", "--path", ".")
    assert (code, out) == (1, "")
    assert re.match(r"error: (\./)?my_msgs/msg/Bad\.msg:1:1: unknown type ", err.replace(f"{tmp_path}/", "")), err
    expected = (
        'error: rosidl-py-gen: no command "std_msgs"\nhint: select packages and interfaces with --filter std_msgs\n'
    )
    assert generate(capsys, "std_msgs") == (2, "", expected)


def test_every_filter_of_the_generator_counts(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, err = generate(capsys, "--filter", "std_srvs", "--filter", "std_msgs/msg/Bool", "--out", str(tmp_path))
    assert (code, err) == (0, "") and "in 4 packages" in out
    assert (tmp_path / "std_srvs").is_dir() and (tmp_path / "std_msgs/msg/_bool.py").is_file()


@pytest.mark.parametrize("group", GROUPS)
def test_help_of_each_group_has_examples_that_can_be_called(group: str, run_here: RunHere) -> None:
    code, out, _ = run_here(group, "--help")
    examples = [shlex.split(line) for line in out.splitlines() if line.startswith(f"  rosidl-py {group} ")]
    assert code == 0 and len(examples) > 1
    for _, *words in examples:
        command: Any = ros_cli.root()
        context = click.Context(command, info_name="rosidl-py")
        while isinstance(command, click.Group):
            _, command, words = command.resolve_command(context, words)
        command.make_context(command.name, words, parent=context)


@pytest.mark.parametrize(
    ("terminals", "text"), [((True, True), "next: rosidl-py bag info drive\n"), ((False, True), "")]
)
def test_next_step_is_printed_on_a_terminal_only(
    terminals: tuple[bool, bool], text: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for stream, is_terminal in zip((sys.stdout, sys.stderr), terminals, strict=True):
        monkeypatch.setattr(stream, "isatty", lambda found=is_terminal: found)
    print_next_step("rosidl-py bag info", "drive")
    assert capsys.readouterr() == ("", text)
