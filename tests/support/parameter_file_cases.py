"""Parameter files and ``-p`` arguments, and what rclpy reads from them.

Run it as ``python tests/support/parameter_file_cases.py record`` to write `GOLDEN` from real rclpy (Jazzy, Kilted).
Without arguments it prints the results of the installed rclpy as JSON; so it imports the standard library only.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

NODES = ("/show", "/ns/show", "/a/b/show")
"""Nodes whose values are read."""
GOLDEN = Path(__file__).resolve().parents[1] / "golden" / "rclpy_parameter_files.json"
REFUSED = "refused"
_SECTION = "ros__parameters"

_NODE_KEYS = """
    /: | //show | /** | /*/show | /ns/**/show | a-b | sh* | ~ | /show/ | show/ | /show | show | ns/show | /ns/show
    /ns//show | ns//show | /* | ** | * | /** /show | /**/show | **/show | */show | /ns/* | /ns/** | /a/** | /a/*/show
    /a/**/show | /*/*/show | /**/b/show | /*/b/** | 1show | show1 | /1ns/show | _show | sh__ow | show.x | sh ow
    /ns/sh* | /ns*/show | /n?/show | ~/show | /~/show | {node} | /sho | /Show | 5 | true | ns/ | /ns/ | /*** | /**/
    /*/** | /**/* | /**/** | ü | /ns/ü | .* | /.* | / | // | /// | ///show | /a/b/show | a/b/show | b/show | /*show
    /show* | *show | **show | /**show | /a/** /show | /a/b/* | /*/*/* | /*/* | /**/**/show | -show | show- | sh\\ow
    /ns/show/x | show/** | /show/** | /show/* | ns/** | ns/* | ns/*/ | /ns/. | ../show | ./show | $(var ns)/show
"""
_NESTED_KEYS = """
    / > show | / > /show | /ns > show | ns > show | /ns > /show | ns/ > show | /ns/ > show | /** > show | ** > show
    /* > show | * > show | / > ns > show | / > ns/show | /a > b > show | /a/b > show | a > b/show | a > * > show
    a > ** > show | a > ** | ns > * | / > ** | / > * | / > / | / > / > show | ns > '' | '' > show | ns > '' > show
    ns > show/ | '~' > show | ns > a-b | / > ns/ > show | a > b > / > show | a/ > b/ > show | /a/ > b/show
    a > /b > show | / > ns > / > show | ** > ** | / > sh*
    a > 1b > show | / > /** | / > '**' | a > b > show > x | / > ns > '*'
"""
_VALUES = {
    "empty list": "p: []",
    "nothing": "p:",
    "empty text": "p: ''",
    "empty text in double quotes": 'p: ""',
    "empty map": "p: {}",
    "null": "p: null",
    "tilde": "p: ~",
    "int and double in a list": "p: [1, 2.0]",
    "int and text in a list": "p: [1, a]",
    "bool and int in a list": "p: [true, 1]",
    "list in a list": "p: [[1, 2], [3]]",
    "list in a list, last": "p: [1, [2]]",
    "empty list in a list": "p: [[]]",
    "map in a list": "p: [{a: 1}]",
    "nothing in a list": "p: [ , ]",
    "null in a list": "p: [null]",
    "empty text in a list": "p: ['']",
    "nothing in a block list": "p:\n      -\n",
    "nothing last in a block list": "p:\n      - a\n      -\n",
    "block list": "p:\n      - 1\n      - 2",
    "trailing comma": "p: [1, 2, ]",
    "nested map": "p: {a: 1, b: {c: x}}",
    "map with an empty map": "p: {a: {}, b: 1}",
    "map with an empty map last": "p: {b: 1, a: {}}",
    "map with an empty list": "p: {a: [], b: 1}",
    "maps with empty maps": "p: {a: {b: {}}}",
    "empty list, then a value": "p: []\n    q: 1",
    "empty map, then a value": "p: {}\n    q: 1",
    "value, then an empty map": "q: 1\n    p: {}",
    "map, then a value": "p: {a: 1}\n    q: 2",
    "map in a map, then values": "p: {a: {b: 1}, c: 2}\n    q: 3",
    "dotted key": "a.b: 1",
    "dotted key and map": "a.b: 1\n    a: {c: 2}",
    "dotted key, then the same in a map": "a.b: 1\n    a: {b: 2}",
    "map, then the same as a dotted key": "a: {b: 1}\n    a.b: 2",
    "map twice": "a: {b: 1}\n    a: {b: 2, c: 3}",
    "map twice with types": "a: {b: 1}\n    a: {b: text}",
    "map thrice, dotted key between": "a: {b: 1}\n    a: {b: 2}\n    a.b: 3\n    a: {c: 4}",
    "dotted key as a map": "a.b: {c: 1, d: 2}\n    e: 3",
    "dotted key as a map in a map": "x: {a.b: {c: 1}, e: 2}\n    f: 3",
    "value, then a map of the same name": "p: 1\n    p: {a: 2}",
    "map, then a value of the same name": "p: {a: 2}\n    p: 1",
    "deep maps": "a: {b: {c: {d: 1}, e: 2}, f: 3}\n    g: 4",
    "key with space": "'a b': 1",
    "empty key": "'': 1",
    "empty key in a map": "p: {'': 1}",
    "number as key": "5: 1",
    "bool as key": "true: x",
    "null as key": "~: x",
    "list as key": "? [a]\n    : 1",
    "map as key": "? {a: 1}\n    : 1",
    "map as key after a value": "q: 1\n    ? {a: 1}\n    : 1",
    "section inside": "ros__parameters: {p: 1}",
    "binary tag": "p: !!binary AQI=",
    "int tag": "p: !!int '5'",
    "str tag": "p: !!str 5",
    "str tag without text": "p: !!str",
    "tag without text": "p: !!int",
    "block text": "p: |\n      a\n      b",
    "empty block text": "p: |\n",
    "empty folded text": "p: >-\n\n    q: 1",
    "merge key": "p: {<<: {a: 1}, b: 2}",
    "number in quotes": "p: '5'",
    "large number": "p: 9223372036854775808",
    "time of day": "p: 1:30",
    "octal number": "p: 010",
    "underscore": "p: 1_000",
    "anchor": "p: &x 1",
    "alias": "p: &x 1\n    q: *x",
    "equals sign": "p: =",
    "dot last": "p.: 1",
    "dot first": ".p: 1",
    "dots in groups": "p.: {.a: 1, b.: {c: 2}}\n    q: 3",
    "slash in the key": "a/b: 1",
    "list of 100": f"p: [{', '.join(map(str, range(100)))}]",
    "question without answer": "? p",
    "nothing after a value": "p: 1\n    q:",
    "same key twice": "p: 1\n    p: 2",
    "same key twice with types": "p: 1\n    p: 2.5",
    "tabs": "p:\t1",
    "empty lists of all kinds": "a: []\n    b: [ ]\n    c: [\n      ]\n    d: {e: []}",
}
_SHOW = f"show:\n  {_SECTION}:\n    "
_DOCUMENTS = {
    "empty file": "",
    "comment": "# x\n",
    "start of a document": "---\n",
    "two empty documents": "---\n---\n",
    "end of a document": "...\n",
    "null": "~\n",
    "list": "- a\n",
    "empty map": "{}\n",
    "text": "hello\n",
    "two": f"{_SHOW}p: 1\n---\n{_SHOW}q: 2\n",
    "three": f"{_SHOW}p: 1\n---\n{_SHOW}q: 2\n---\n{_SHOW}p: 3\n",
    "same value": f"{_SHOW}p: 1\n---\n{_SHOW}p: 2\n",
    "other type": f"{_SHOW}p: 1\n---\n{_SHOW}p: text\n",
    "other type back": f"{_SHOW}p: text\n---\n{_SHOW}p: 1\n",
    "shorter list": f"{_SHOW}p: [1, 2, 3]\n---\n{_SHOW}p: [4]\n",
    "list, then value": f"{_SHOW}p: [1, 2, 3]\n---\n{_SHOW}p: 4\n",
    "value, then list": f"{_SHOW}p: 4\n---\n{_SHOW}p: [1, 2, 3]\n",
    "list, then list of another type": f"{_SHOW}p: [a]\n---\n{_SHOW}p: [1.5]\n",
    "list, then empty list": f"{_SHOW}p: [1, 2]\n---\n{_SHOW}p: []\n",
    "empty list, then list": f"{_SHOW}p: []\n---\n{_SHOW}p: [1, 2]\n",
    "maps": f"{_SHOW}g: {{a: 1, b: 2}}\n---\n{_SHOW}g: {{b: text, c: 3}}\n",
    "maps with empty list": f"{_SHOW}g: {{a: [1]}}\n---\n{_SHOW}g: {{a: []}}\n",
    "ended": f"{_SHOW}p: 1\n...\n---\n{_SHOW}q: 2\n...\n",
    "ended without start": f"{_SHOW}p: 1\n...\n{_SHOW}q: 2\n",
    "empty first": f"---\n---\n{_SHOW}q: 2\n",
    "empty last": f"{_SHOW}q: 2\n---\n",
    "empty between": f"{_SHOW}p: 1\n---\n---\n{_SHOW}q: 2\n",
    "comment last": f"{_SHOW}q: 2\n---\n# x\n",
    "empty map first": f"{{}}\n---\n{_SHOW}q: 2\n",
    "empty map last": f"{_SHOW}q: 2\n--- {{}}\n",
    "text first": f"hello\n---\n{_SHOW}q: 2\n",
    "text last": f"{_SHOW}q: 2\n---\nhello\n",
    "list last": f"{_SHOW}q: 2\n---\n- a\n",
    "list first": f"- a\n---\n{_SHOW}q: 2\n",
    "two texts": "a\n---\nb\n",
    "error in the second": f"{_SHOW}p: 1\n---\na: [\n",
    "error in the first": f"a: ]\n---\n{_SHOW}p: 1\n",
    "value in the second": f"{_SHOW}p: 1\n---\nother: 5\n",
    "wrong node key in the second": f"{_SHOW}p: 1\n---\na-b: {{{_SECTION}: {{q: 1}}}}\n",
    "YAML directive": f"%YAML 1.1\n---\n{_SHOW}p: 1\n",
    "tag directive": f"%TAG ! tag:x,2000:\n---\n{_SHOW}p: 1\n",
    "alias of the first": f"{_SHOW}p: &a 1\n---\n{_SHOW}q: *a\n",
    "byte order mark": f"\ufeff{_SHOW}p: 1\n",
    "wildcard in the second": f"{_SHOW}p: 1\n---\n/**:\n  {_SECTION}:\n    p: 2\n",
    "node in the second": f"/**:\n  {_SECTION}:\n    p: 2\n---\n{_SHOW}p: 1\n",
    "nested in the second": f"{_SHOW}p: 1\n---\nns:\n  show:\n    {_SECTION}:\n      p: 2\n",
    "root in the second": f"{_SHOW}p: 1\n---\n/:\n  show:\n    {_SECTION}:\n      p: 2\n",
}
_FORMS = {
    "wildcard, node, wildcard": f"/**:\n  {_SECTION}:\n    p: 1\n{_SHOW}p: 2\n/**:\n  {_SECTION}:\n    p: 3\n",
    "wildcard, node": f"/**:\n  {_SECTION}:\n    p: 1\n{_SHOW}p: 2\n",
    "node, wildcard": f"{_SHOW}p: 2\n/**:\n  {_SECTION}:\n    p: 1\n",
    "node with and without slash": f"/show:\n  {_SECTION}:\n    p: 1\n{_SHOW}p: 2\n/show:\n  {_SECTION}:\n    p: 3\n",
    "node twice": f"{_SHOW}p: 1\n{_SHOW}p: 2\n    q: 3\n",
    "section twice": f"show:\n  {_SECTION}:\n    p: 1\n  {_SECTION}:\n    q: 2\n",
    "section with a longer name": f"show:\n  {_SECTION}_of_all:\n    p: 1\n",
    "section at the root": f"{_SECTION}:\n  p: 1\n",
    "section in a section": f"show:\n  {_SECTION}:\n    {_SECTION}:\n      p: 1\n",
    "section with nothing": f"show:\n  {_SECTION}:\n",
    "section with an empty map": f"show:\n  {_SECTION}: {{}}\n",
    "section with an empty map, then a node": f"other:\n  {_SECTION}: {{}}\n{_SHOW}p: 1\n",
    "section with a list": f"show:\n  {_SECTION}: [1]\n",
    "section with an empty list": f"show:\n  {_SECTION}: []\n",
    "section with a value": f"show:\n  {_SECTION}: 5\n",
    "section with an empty text": f"show:\n  {_SECTION}: ''\n",
    "section with another case": "show:\n  ROS__PARAMETERS:\n    p: 1\n",
    "section in quotes": f"show:\n  '{_SECTION}':\n    p: 1\n",
    "sections in maps of a section": f"show:\n  {_SECTION}:\n    a: {{{_SECTION}: {{b: 1}}}}\n",
    "node with nothing": "show:\n",
    "node with an empty map": "show: {}\n",
    "node with a list": "show: []\n",
    "node with a value": "show: 5\n",
    "empty node, then a node": f"other: {{}}\n{_SHOW}p: 1\n",
    "node with nothing, then a node": f"other:\n{_SHOW}p: 1\n",
    "empty node in a namespace": f"ns:\n  other: {{}}\n  show:\n    {_SECTION}:\n      p: 1\n",
    "two nodes in a namespace": f"ns:\n  o:\n    {_SECTION}:\n      q: 2\n  show:\n    {_SECTION}:\n      p: 1\n",
    "namespace, then root": f"ns:\n  show:\n    {_SECTION}:\n      q: 2\n{_SHOW}p: 1\n",
    "node with a child": f"ns:\n  {_SECTION}:\n    p: 1\n  show:\n    {_SECTION}:\n      q: 2\n",
    "node with a child before": f"ns:\n  show:\n    {_SECTION}:\n      q: 2\n  {_SECTION}:\n    p: 1\n",
    "key with slash and sibling": f"a:\n  b/show:\n    {_SECTION}:\n      p: 1\n  show:\n    {_SECTION}:\n      q: 2\n",
    "root with two nodes": f"/:\n  show:\n    {_SECTION}:\n      p: 1\n  other:\n    {_SECTION}:\n      q: 2\n",
    "root with a namespace": f"/:\n  ns:\n    show:\n      {_SECTION}:\n        p: 1\n"
    f"  show:\n    {_SECTION}:\n      q: 2\n{_SHOW}r: 3\n",
    "value and section": f"show:\n  x: 1\n  {_SECTION}:\n    p: 1\n",
    "section, then value": f"show:\n  {_SECTION}:\n    p: 1\n  x: 1\n",
    "section, then map": f"show:\n  {_SECTION}:\n    p: 1\n  x: {{}}\n",
    "empty node key": f"'':\n  {_SECTION}:\n    p: 1\n",
    "null as node key": f"~:\n  {_SECTION}:\n    p: 1\n",
    "nothing as node key": f"? \n: {_SECTION}: {{p: 1}}\n",
    "list as node key": f"? [show]\n: {_SECTION}: {{p: 1}}\n",
    "flow maps": f"{{show: {{{_SECTION}: {{p: 1}}}}, ns: {{show: {{{_SECTION}: {{p: 2}}}}}}}}\n",
    "maps after maps": f"{_SHOW}a: {{x: 1}}\n    b: {{y: 2}}\n    c: 3\nother:\n  {_SECTION}:\n    d: 4\n"
    f"/**:\n  {_SECTION}:\n    e: {{z: 5}}\n    f: 6\n",
    "longest name": f"{'n' * 255}:\n  {_SECTION}:\n    p: 1\n{_SHOW}q: 1\n",
    "too long name": f"{'n' * 256}:\n  {_SECTION}:\n    p: 1\n{_SHOW}q: 1\n",
    "long namespace": f"/{'n' * 243}/show:\n  {_SECTION}:\n    p: 1\n{_SHOW}q: 1\n",
    "too long namespace": f"/{'n' * 250}/show:\n  {_SECTION}:\n    p: 1\n{_SHOW}q: 1\n",
    "long namespace of parts": f"{'/nnnnnnnnn' * 60}/show:\n  {_SECTION}:\n    p: 1\n{_SHOW}q: 1\n",
    "wrong key of another node": f"{_SHOW}p: 1\na-b:\n  {_SECTION}:\n    p: 1\n",
    "wrong key without section": f"{_SHOW}p: 1\na-b: {{}}\n",
    "wrong keys without section": f"{_SHOW}p: 1\na-b: {{b: {{}}}}\n",
}
_ALL = f"/**:\n  {_SECTION}:\n    p: 1\n"
_COMMAND_LINES: dict[str, tuple[list[str], list[str]]] = {
    "two files": ([f"{_SHOW}p: 1\n", f"{_SHOW}p: 2\n    q: 3\n"], ["FILE0", "FILE1"]),
    "node, then wildcard": ([f"{_SHOW}p: 2\n", _ALL], ["FILE0", "FILE1"]),
    "wildcard, then node": ([_ALL, f"{_SHOW}p: 2\n"], ["FILE0", "FILE1"]),
    "wildcard, node, wildcard": ([_ALL, f"{_SHOW}p: 2\n", _ALL.replace("1", "3")], ["FILE0", "FILE1", "FILE2"]),
    "same file twice": ([f"{_SHOW}p: 2\n    g: {{a: 1}}\n"], ["FILE0", "FILE0"]),
    "files of two types": ([f"{_SHOW}p: 1.5\n", f"{_SHOW}p: 2\n"], ["FILE0", "FILE1"]),
    "files of two types in a map": ([f"{_SHOW}g: {{p: 1}}\n", f"{_SHOW}g: {{p: 2.5}}\n"], ["FILE0", "FILE1"]),
    "empty list in the second file": ([f"{_SHOW}p: [1]\n", f"{_SHOW}p: []\n"], ["FILE0", "FILE1"]),
    "empty list in the first file": ([f"{_SHOW}p: []\n", f"{_SHOW}p: [1]\n"], ["FILE0", "FILE1"]),
    "empty list in a map of the second file": (
        [f"{_SHOW}g: {{p: [1]}}\n", f"{_SHOW}g: {{p: []}}\n"],
        ["FILE0", "FILE1"],
    ),
    "node, -p": ([f"{_SHOW}p: 1\n"], ["FILE0", "-p", "p:=5"]),
    "-p, node": ([f"{_SHOW}p: 1\n"], ["-p", "p:=5", "FILE0"]),
    "wildcard and node, -p": ([_ALL + f"{_SHOW}p: 2\n"], ["FILE0", "-p", "p:=5"]),
    "wildcard and node, -p of the node": ([_ALL + f"{_SHOW}p: 2\n"], ["FILE0", "-p", "show:p:=5"]),
    "-p of the node, wildcard": ([_ALL], ["-p", "show:p:=5", "FILE0"]),
    "node in a namespace, -p of the node": (
        [f"ns:\n  {_SHOW}p: 1\n".replace("\n  ", "\n    ")],
        ["FILE0", "-p", "show:p:=5"],
    ),
    "dotted -p, then a map": ([f"{_SHOW}g: {{p: 1}}\n"], ["-p", "show:g.p:=5", "FILE0"]),
    "map, then a dotted -p": ([f"{_SHOW}g: {{p: 1}}\n"], ["FILE0", "-p", "show:g.p:=5"]),
    "-p twice": ([], ["-p", "p:=1", "-p", "p:=2"]),
    "-p with two types": ([], ["-p", "p:=1", "-p", "p:=text"]),
    "-p with two types back": ([], ["-p", "p:=text", "-p", "p:=1"]),
    "-p list, empty list": ([], ["-p", "p:=[1]", "-p", "p:=[]"]),
}
_ARGUMENTS = r"""
    p:= | p:=[] | p:='' | p:={} | p:=null | p:=~ | p:={a: 1} | p:=[[1]] | p:=[1, a] | p:=1\n--- 2 | p:=--- 1
    p:=1 # x | p:=a: b | p:=- 1 | p:=&a 1 | p:=!!str 5 | p:=text\n... | :=1 | a b:=1 | a.b:=1 | a-b:=1 | a/b:=1
    sh*:p:=1 | p:=1\n--- x | *:p:=1 | **:p:=1 | /**:p:=1 | a-b:p:=1 | show::p:=1 | p | p=1 | p:=:= | p:=a:=b | ~p:=1
    /p:=1 | p/:=1 | 1p:=1 | a..b:=1 | .a:=1 | a.:=1 | ü:=1 | p:=ü | p:=[1,2] | p:=[a, 'b'] | __p:=1 | p*:=1 | {p}:=1
    a__b:=1 | a___b:=1 | a_:=1 | _a:=1 | _:=1 | __:=1 | a/__b:=1 | a_/b:=1 | a//b:=1 | a/1:=1 | /:=1 | a.1:=1
    a./b:=1 | a/.b:=1 | a1:=1 | _1:=1 | a._b:=1 | a_.b:=1 | a_____b:=1 | a.__b:=1 | rostopic:=1 | rostopic://a:=1
    show:p:=1 | Show:p:=1 | _show:p:=1 | 1s:p:=1 | show:a.b:=1 | show:1p:=1 | show:p:=[] | s__how:p:=1 | p:=[1, [2]]
    p:=[ ] | p:=[\n] | p:="" | p:=" " | p:=|\n a | *p:=1
"""

DEVIATIONS: dict[str, Any] = {
    **dict.fromkeys(
        (
            "value: list in a list, last",
            "value: empty list in a list",
            "value: map in a list",
            "value: map with an empty map",
            "value: map as key after a value",
            "form: section with an empty list",
            "-p p:=[[1]]",
            "-p p:=[1, [2]]",
        ),
        REFUSED,
    ),
    "value: binary tag": [{"p": ["BYTE_ARRAY", ["b'\\x01'", "b'\\x02'"]]}, {}, {}],
}
"""Results of ours that differ: rcl reads other values than are written, and has no form for byte arrays."""


def _cells(text: str) -> Iterator[str]:
    for line in text.strip().splitlines():
        yield from (cell.strip().replace("\\n", "\n") for cell in line.split(" | "))


def _nested(*keys: str) -> str:
    lines = [f"{'  ' * level}{key}:" for level, key in enumerate((*keys, _SECTION))]
    return "\n".join([*lines, f"{'  ' * len(lines)}p: 1\n"])


def cases() -> dict[str, tuple[list[str], list[str]]]:
    """Return name -> texts of files, and arguments in which ``FILE0`` is the first file."""
    found: dict[str, tuple[list[str], list[str]]] = {}
    for key in _cells(_NODE_KEYS):
        found[f"node key {key}"] = [_nested(json.dumps(key, ensure_ascii=False))], ["FILE0"]
    for keys in _cells(_NESTED_KEYS):
        found[f"nested keys {keys}"] = [_nested(*keys.split(" > "))], ["FILE0"]
    for kind, texts in (
        ("value", {k: f"{_SHOW}{v}\n" for k, v in _VALUES.items()}),
        ("form", _FORMS),
        ("documents", _DOCUMENTS),
    ):
        found |= {f"{kind}: {name}": ([text], ["FILE0"]) for name, text in texts.items()}
    found |= {f"command line: {name}": case for name, case in _COMMAND_LINES.items()}
    found |= {f"-p {text}": ([], ["-p", text]) for text in _cells(_ARGUMENTS)}
    return found


def results(read: Callable[[list[str], str], dict[str, Any]]) -> dict[str, Any]:
    """Return the results of all cases: a value for each node, or one for all; `read` raises ValueError if refused."""
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, (texts, words) in cases().items():
            paths = [os.path.join(folder, f"{number}.yaml") for number in range(len(texts))]
            for path, text in zip(paths, texts, strict=True):
                with open(path, "w", encoding="utf-8", newline="") as file:
                    file.write(text)
            arguments = ["--ros-args"]
            for word in words:
                arguments += ["--params-file", paths[int(word[4:])]] if word.startswith("FILE") else [word]
            each: list[Any] = []
            for node in NODES:
                try:
                    each.append(dict(sorted(read(arguments, node).items())))
                except ValueError:
                    each.append(REFUSED)
            found[name] = each[0] if each[0] == each[1] == each[2] else each
    return found


def _rclpy_results() -> dict[str, Any]:
    import rclpy
    from rclpy.node import Node

    rclpy.init(args=[])

    def read(arguments: list[str], name: str) -> dict[str, Any]:
        namespace, _, own = name.rpartition("/")
        try:
            node = Node(
                own,
                namespace=namespace or "/",
                cli_args=arguments,
                use_global_arguments=False,
                enable_rosout=False,
                start_parameter_services=False,
            )
        except Exception as error:
            raise ValueError(str(error)) from error
        overrides = node._parameter_overrides
        node.destroy_node()
        return {key: [one.type_.name, _plain(one.value)] for key, one in overrides.items()}

    found = results(read)
    rclpy.shutdown()
    return found


def _plain(value: Any) -> Any:
    return [str(one) if isinstance(one, bytes) else one for one in value] if isinstance(value, (list, tuple)) else value


def _record() -> None:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from support.environments import rclpy_python

    by_distribution: dict[str, dict[str, Any]] = {}
    for distribution in ("jazzy", "kilted"):
        environ = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": "97"}
        done = subprocess.run(
            [rclpy_python(distribution), __file__], env=environ, stdout=subprocess.PIPE, text=True, check=True
        )
        by_distribution[distribution] = json.loads(done.stdout.splitlines()[-1])
    jazzy, kilted = by_distribution["jazzy"], by_distribution["kilted"]
    differing = {name: value for name, value in jazzy.items() if value != kilted[name]}
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(value)}" for name, value in kilted.items())
    GOLDEN.write_text(f'{{"kilted": {{\n{lines}\n}},\n"jazzy_differs": {json.dumps(differing)}}}\n', encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] == ["record"]:
        _record()
    else:
        print(json.dumps(_rclpy_results()))
