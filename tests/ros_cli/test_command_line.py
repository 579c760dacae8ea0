"""``rosidl-py`` as a whole: help, how runs end."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
from typing import TYPE_CHECKING

import click
import pytest

from rosidl_py_gen import ros_cli

if TYPE_CHECKING:
    from collections.abc import Iterator


def test_help_lists_the_groups(capsys: pytest.CaptureFixture[str]) -> None:
    ros_cli.main(["--help"])
    assert "\n  topic " in capsys.readouterr().out


def test_an_unknown_command_is_a_wrong_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        ros_cli.main(["topik"])
    assert end.value.code == 2
    assert 'did you mean "topic"?' in capsys.readouterr().err


def test_an_error_of_several_lines_keeps_them(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        ros_cli.main(["topic", "type", "/a b", "--discovery", "off"])
    assert end.value.code == 1
    assert capsys.readouterr().err.endswith(" are\n    /a b\n      ^\n")
    ros_cli.report("a peer says \x1b[2J\nerror: b")
    assert capsys.readouterr().err == "error: a peer says \ufffd[2J\\nerror: b\n"


def test_help_and_completion_load_neither_the_runtime_nor_rich() -> None:
    code = (
        "import sys, click; from rosidl_py_gen import ros_cli\n"
        "def load(group):\n"
        "    for name in group.list_commands(None):\n"
        "        command = group.get_command(None, name)\n"
        "        if isinstance(command, click.Group): load(command)\n"
        "ours = ['rosidl_py_gen.' + name for name in ('runtime', 'bags', 'compiler', 'tables')]\n"
        "load(ros_cli.root())\n"
        "print([name for name in (*ours, 'rich', 'yaml', 'numpy', 'asyncio') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_a_command_does_not_load_the_others_of_its_group() -> None:
    code = (
        "import sys; from rosidl_py_gen.ros_cli import main\n"
        "try: main(['bag', 'table', '--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted(name for name in sys.modules if name.startswith('rosidl_py_gen.ros_cli.bag.')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "['rosidl_py_gen.ros_cli.bag.table']"


def test_numpy_and_the_node_are_loaded_while_the_context_listens() -> None:
    code = (
        "import sys; from rosidl_py_gen.ros_cli import command_node\n"
        "import rosidl_py_gen.ros_cli.topic.info, rosidl_py_gen.ros_cli.graph.command\n"
        "print([name for name in ('rosidl_py_gen.runtime.node.node', 'numpy') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_reader_that_has_enough_ends_a_command_quietly() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "interface", "list"]
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_are_no_trouble(closed: str) -> None:
    command = f"{sys.executable} -m rosidl_py_gen.ros_cli topic list --discovery localhost {closed}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    notes = [line for line in done.stderr.splitlines() if not line.startswith("no nodes were found in domain")]
    assert (done.returncode, notes) == (0, [])


def _commands(group: click.Group, context: click.Context) -> Iterator[click.Command]:
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from _commands(command, context)
        else:
            yield command


ROOT = ros_cli.root()
# A command retains the help option of the first context that asks for it, so each context here has the names of ours.
CONTEXT = click.Context(ROOT, **ROOT.context_settings)
COMMANDS = [*_commands(ROOT, CONTEXT)]


def test_help_has_an_example_and_names_of_values_and_commands_with_a_node_accept_no_daemon() -> None:
    for command in COMMANDS:
        context = click.Context(command, CONTEXT, command.name, max_content_width=200)
        text = command.get_help(context)
        assert "RANGE" not in text.replace("DISCOVERY_RANGE", ""), command.name
        assert re.search(rf"rosidl-py (\w+ )?{command.name}\b", text), command.name
        names = {name for parameter in command.params for name in parameter.opts}
        assert ("--domain" in names) == ("--no-daemon" in names), command.name
        shows_itself = {"completion", "launch", "play", "plot", "test", "zenoh-router"} | {
            "sql"
        }  # which has --format json
        assert "--json" in names or command.name in shows_itself, command.name


def test_topics_takes_several_words_in_every_command_of_bags() -> None:
    group = ROOT.get_command(CONTEXT, "bag")
    assert isinstance(group, click.Group)
    for words, topics, others in [
        ("record --topics /a /b", "more_topics", {"topics": ()}),
        ("play bag --topics /a /b", "topics", {"path": "bag"}),
        ("convert --topics /a bag out --topics /b", "topics", {"path": "bag", "output": "out"}),
        ("convert --topics /a /b -- bag out", "topics", {"path": "bag", "output": "out"}),
        ("play --topics /a /b --rate 2 -- bag", "topics", {"path": "bag", "rate": 2.0}),
        ("convert bag out --topics /a /b --duration 3", "topics", {"duration_s": 3.0}),
        ("table bag1 bag2 --topics /a /b --out x", "topics", {"bags": ("bag1", "bag2"), "out": "x"}),
        ("table --topics /a bag1 --topics /b -o x", "topics", {"bags": ("bag1",), "out": "x"}),
        ("migrate bag --topics /a /b --path new", "topics", {"path": "bag", "paths": ("new",)}),
    ]:
        name, *rest = words.split()
        command = group.get_command(CONTEXT, name)
        assert command is not None
        found = command.make_context(name, rest, CONTEXT).params
        assert found[topics] == ("/a", "/b"), words
        assert others.items() <= found.items(), words


@pytest.mark.parametrize("command", COMMANDS, ids=lambda one: f"{one.callback.__module__.split('.')[-1]}.{one.name}")
def test_what_click_hands_on_is_what_the_command_takes(command: click.Command, monkeypatch: pytest.MonkeyPatch) -> None:
    context = click.Context(command, CONTEXT)
    for parameter in command.params:
        if parameter.expose_value:
            context.params[parameter.name or ""] = "given"
        else:  # it hands on a value by itself, as `network` and `qos`
            assert parameter.callback is not None
            parameter.callback(context, parameter, None)
    assert command.callback is not None
    function = inspect.unwrap(command.callback)
    signature = inspect.signature(function)
    kinds = {one.kind for one in signature.parameters.values()}
    if hasattr(getattr(command.callback, "__wrapped__", None), "__wrapped__"):  # `options.node_verb`
        context.params["command_node"] = context.params.pop("network")
    signature.bind(**context.params)
    if inspect.Parameter.VAR_KEYWORD in kinds and command.name != "launch":  # which checks the values at once
        for does in ("playback.player.play_bag", "recording.recorder.record_bag", "foxglove.serve.serve"):
            monkeypatch.setattr(f"rosidl_py_gen.ros_cli.{does}", lambda network, options: None)
        made = function(**context.params)  # what several commands share takes its arguments now
        main = made.main if isinstance(made, ros_cli.AsyncCommand) else made
        if main is not None:
            main.close()
