"""The pages on the command lines name every command and every option, and only options that exist."""

from __future__ import annotations

import itertools
import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest
from support.folders import ROOT
from support.markdown_pages import PAGES, blocks, prose

from rosidl_py_gen import generator_cli, ros_cli

if TYPE_CHECKING:
    from collections.abc import Iterator

COMMANDS = ROOT / "docs/commands"
SITE = [page for page in PAGES if page.parent.name != "internals"]
PAGE_OF = {
    "action": "commands/topic-service-action.md",
    "bag": "commands/bag.md",
    "completion": "commands/index.md",
    "demo": "commands/demo.md",
    "doctor": "commands/diagnose.md",
    "foxglove": "howto/live-view.md",
    "graph": "commands/diagnose.md",
    "interface": "commands/diagnose.md",
    "launch": "howto/launch.md",
    "lifecycle": "commands/node-param-lifecycle.md",
    "log": "commands/diagnose.md",
    "node": "commands/node-param-lifecycle.md",
    "prefix": "howto/launch.md",
    "param": "commands/node-param-lifecycle.md",
    "run": "start/from-rclpy.md",
    "security": "howto/security.md",
    "service": "commands/topic-service-action.md",
    "test": "howto/launch.md",
    "tf": "commands/diagnose.md",
    "topic": "commands/topic-service-action.md",
    "zenoh-router": "howto/zenoh.md",
}
SHARED = {
    *("--help", "--version", "--json", "--domain", "--discovery", "--spin-time", "--no-daemon", "--path", "--distro"),
}
"""Options that many commands have; commands/index.md describes them."""
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
SPAN = re.compile(r"`([^`]+)`")


def commands_below(command: click.Command, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    yield words, command
    if isinstance(command, click.Group):
        context = click.Context(command, info_name=words[-1])
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from commands_below(below, (*words, name))


ALL = {
    words: command
    for program, root in (("rosidl-py", ros_cli.root()), ("rosidl-py-gen", generator_cli.cli))
    for words, command in commands_below(root, (program,))
}


def options_of(command: click.Command) -> set[str]:
    """Return all options of a command, short ones too."""
    own = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    return {name for name in own if name.startswith("-")} | {"--help", "-h"}


def long_options_in_help(command: click.Command) -> set[str]:
    shown = [one for one in command.params if isinstance(one, click.Option) and not one.hidden]
    return {name for option in shown for name in option.opts if name.startswith("--")} | {"--help"}


def page_of(words: tuple[str, ...]) -> Path:
    if words[0] == "rosidl-py-gen":
        return COMMANDS / "rosidl-py-gen.md"
    return ROOT / "docs" / (PAGE_OF[words[1]] if len(words) > 1 else "commands/index.md")


def named_options(text: str) -> set[str]:
    """Return the options in inline code, except those of the command lines of other programs."""
    spans = [span for span in SPAN.findall(text) if not re.match(r"--ros-args|ros2 |git |pip |docker ", span)]
    return {option for span in spans for option in OPTION.findall(span)}


@pytest.mark.parametrize("words", ALL, ids=" ".join)
def test_each_command_and_its_options_are_documented(words: tuple[str, ...]) -> None:
    page = page_of(words)
    used = "\n".join(block.text for block in blocks(page) if block.language == "sh")
    assert re.search(rf"\b{re.escape(words[-1])}\b", prose(page) + used)
    shared = SHARED if words[0] == "rosidl-py" else set()
    named = named_options(prose(page)) | set(OPTION.findall(used))
    assert long_options_in_help(ALL[words]) - named - shared == set(), page


@pytest.mark.parametrize("words", ALL, ids=" ".join)
def test_help_states_no_limit_that_an_option_does_not_have(words: tuple[str, ...]) -> None:
    command = ALL[words]
    assert "None" not in command.get_help(click.Context(command, info_name=" ".join(words)))


def test_command_index_page_names_shared_options() -> None:
    index = prose(COMMANDS / "index.md")
    assert SHARED - named_options(index) == set()
    assert [name for name in PAGE_OF if f"`{name}`" not in index] == []


@pytest.mark.parametrize("page", sorted(COMMANDS.glob("*.md")), ids=lambda page: str(page.name))
def test_documented_options_exist(page: Path) -> None:
    text = prose(page)
    commands = [command for words, command in ALL.items() if page_of(words) == page or page.stem == "index"]
    existing = set().union(*map(options_of, commands))
    absent = named_options("".join(re.findall(r"These options do not exist:(.*?)\n\n", text, re.DOTALL)))
    assert absent & existing == set()
    assert named_options(text) - absent - existing - SHARED == set()


def command_lines() -> Iterator[tuple[str, list[str]]]:
    """Return (page, words of a command line) of everything that readers may type."""
    for page in SITE:
        found = [(block.language, block.text.replace("\\\n", "").splitlines()) for block in blocks(page)]
        shell = [line for language, lines in found if language == "sh" for line in lines]
        shown = [line[2:] for _, lines in found for line in lines if line.startswith("$ ")]
        spans = [" ".join(span.split()) for span in SPAN.findall(prose(page))]
        for line in [*shell, *shown, *spans]:
            if re.match(r"rosidl-py(-gen)? ", line):
                lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
                lexer.whitespace_split = True
                yield str(page.relative_to(ROOT)), list(itertools.takewhile(lambda word: word.strip("|;>&"), lexer))


def test_command_lines_in_documentation_use_existing_options() -> None:
    wrong = []
    lines = list(command_lines())
    assert len(lines) > 100
    for page, words in lines:
        length = max(number for number in range(1, 4) if tuple(words[:number]) in ALL)
        command, arguments = ALL[tuple(words[:length])], words[length:]
        if words[1:2] == ["run"]:  # what follows the program are its arguments
            arguments = list(itertools.takewhile(lambda word: word.startswith("--"), arguments))
        given = {word.partition("=")[0] for word in arguments if re.match(r"--[a-z]|-[A-Za-z]$", word)}
        wrong += [(page, words, option) for option in sorted(given - options_of(command))]
    assert wrong == []
