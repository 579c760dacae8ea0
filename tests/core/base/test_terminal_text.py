"""Output of untrusted text: conversion to printable text, and commands that print only converted text."""

from __future__ import annotations

import ast
import json
import math

from support.folders import ROOT

from rosidl_py_gen.base.terminal_text import escape_json, json_text, printable_lines

PACKAGE = ROOT / "rosidl_py_gen"
HOSTILE = "\x1b]0;t\x07\x9b2J\x7f\u202e\u2066\u200b\ufeff\ud800\U000e0041\x00\r"
FOLDERS = (
    "command_support",
    "compiler",
    "foxglove",
    "generator_cli",
    "plotting",
    "prefix",
    "program_runner",
    "ros_cli",
    "security",
)
PRINTERS = {
    "generator_cli/command_line.py": "the functions of this command line",
    "generator_cli/commands.py": "a progress bar without names",
    "compiler/regenerate.py": "for maintainers: paths of this package",
    "command_support/terminal_output.py": "the functions of this command line",
    "ros_cli/__init__.py": "warnings, and flushing",
    "command_support/errors.py": "errors",
    "ros_cli/completion.py": "the scripts of click",
    "command_support/self_test_process.py": "one word for its own parent process",
    "ros_cli/zenoh_router.py": "its own texts, made printable",
}


def test_printable_text_keeps_lines_and_tabs_but_no_terminal_control_characters() -> None:
    assert printable_lines("a\r\nb\tc\nü 漢 🙂") == "a\nb\tc\nü 漢 🙂"
    shown = printable_lines(HOSTILE)
    assert len(shown) == len(HOSTILE) and shown.isprintable()


def test_json_text_is_valid_and_printable_and_preserves_every_value() -> None:
    data = {HOSTILE: [HOSTILE, ("ü 漢 🙂", 1, None, True)], "x": 1e300, "big": 2**70}
    for indent in (None, 2):
        text = json_text(data, indent=indent)
        assert text.replace("\n", "").isprintable() and "ü 漢 🙂" in text
        assert json.loads(text) == {**data, HOSTILE: [HOSTILE, ["ü 漢 🙂", 1, None, True]]}
    inside = {"a": [math.nan, {"b": (math.inf, -math.inf, 1.5)}]}
    assert json_text(inside) == '{"a": ["NaN", {"b": ["Infinity", "-Infinity", 1.5]}]}'
    assert escape_json('"\U000e0041"') == '"\\udb40\\udc41"'


def _prints(node: ast.AST) -> bool:
    if not isinstance(node, ast.Call | ast.Attribute):
        return False
    text = ast.unparse(node.func if isinstance(node, ast.Call) else node)
    return text in ("print", "click.echo", "click.secho", "click.progressbar", "sys.stdout.write", "sys.stdout.flush")


def test_commands_print_only_through_functions_that_make_text_printable() -> None:
    found = {
        str(path.relative_to(PACKAGE))
        for folder in FOLDERS
        for path in PACKAGE.joinpath(folder).rglob("*.py")
        if any(_prints(node) for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    }
    assert found == PRINTERS.keys()
