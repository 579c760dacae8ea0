"""``rosidl-py interface`` of types that are on no search path, but were described by a node once."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

import pytest
from support.announced_types import Told, fresh, told_by
from support.node_fixtures import World

from rosidl_py_gen import ros_cli
from rosidl_py_gen.cdr.codec import encode
from rosidl_py_gen.type_loading.disk_cache import VARIABLE, store_description

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Run = Callable[..., tuple[int, str, str]]

POINT = "nowhere_msgs/msg/Inner"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], cache: Path) -> Run:
    def call(*arguments: str) -> tuple[int, str, str]:
        try:
            ros_cli.main(["interface", *arguments])
        except SystemExit as end:
            return int(end.code or 0), *capsys.readouterr()
        return 0, *capsys.readouterr()

    return call


def keep(told: Told, *parts: str, sources: bool = True) -> None:
    for part in parts or ("",):
        name = told.name + part
        store_description(told.library.type_hash(name), encode(told.answer(name if part else "", sources=sources)))


async def test_what_a_node_described_is_shown_later(memory: World, run: Run) -> None:
    told = fresh("# how fast\nfloat64 speed 1.5\nint32 MOST=7")
    node = memory.node()
    told_by(memory, told)
    await node.resolve_type("/t", timeout_s=10)
    memory.close()
    code, out, err = run("show", told.name)
    assert (code, out) == (0, "# how fast\nfloat64 speed 1.5\nint32 MOST=7\n")
    assert err == f"{told.name} is not on the search path; using the cached definition {told.hash}\n"
    assert run("show", told.name.replace("/msg/", "/"))[1] == out
    assert run("hash", told.name)[1] == f"{told.hash}  {told.name}\n"
    assert json.loads(run("proto", "--json", told.name)[1]) == {"speed": 1.5}
    assert json.loads(run("show", "--json", told.name)[1])["hash"] == told.hash


def test_nested_types_are_known_from_what_contains_them(run: Run) -> None:
    told = fresh("Inner[] inner", **{POINT: "int8 x\nint8 y"})
    keep(told)
    assert run("show", told.name)[1] == "Inner[] inner\n\tint8 x\n\tint8 y\n"
    assert run("show", POINT)[1] == "int8 x\nint8 y\n"


@pytest.mark.parametrize(
    ("kind", "text", "parts", "example"),
    [
        ("srv", "int8 a\n---\nint8 b", [], {"a": 0}),
        ("srv", "int8 a\n---\nint8 b", ["_Request", "_Response"], {"a": 0}),
        (
            "action",
            "int8 a\n---\nint8 b\n---\nint8 c",
            ["_SendGoal_Request", "_GetResult_Response", "_FeedbackMessage"],
            {"a": 0},
        ),
    ],
)
def test_services_and_actions_are_put_together_of_their_parts(
    run: Run, kind: str, text: str, parts: list[str], example: Any
) -> None:
    told = fresh(text, kind)
    keep(told, *parts)
    code, out, err = run("show", told.name)
    assert (code, out) == (0, text + "\n"), err
    assert json.loads(run("proto", "--json", told.name)[1]) == example
    assert run("hash", told.name)[1] == f"{told.hash}  {told.name}\n"


def test_of_several_definitions_the_newest_is_shown_and_the_others_are_named(run: Run, cache: Path) -> None:
    old = fresh("int8 x")
    new = Told(old.name, "int8 x\nint8 y")
    for age, told in enumerate((old, new)):
        keep(told)
        os.utime(cache / f"{told.hash}.cdr", (age, age))
    _, out, err = run("show", old.name)
    assert out == "int8 x\nint8 y\n"
    assert err.endswith(f"{new.hash}; other cached definitions: {old.hash}\n")


def test_halves_of_several_definitions_are_not_put_together(run: Run) -> None:
    old = fresh("int8 a\n---\nint8 b", "srv")
    new = Told(old.name, "int8 a2\n---\nint8 b")
    keep(old, "_Request", "_Response")
    keep(new, "_Request")
    code, out, err = run("show", old.name)
    assert (code, out) == (1, "")
    assert f"several definitions of {old.name}_Request" in err


def test_what_was_changed_on_disk_is_not_shown(run: Run, cache: Path) -> None:
    told, other = fresh(), fresh("int8 z")
    keep(told)
    (cache / f"{told.hash}.cdr").write_bytes(encode(Told(told.name, "int8 evil").answer()))
    (cache / f"{other.hash}.cdr").write_bytes(b"\0\1\0\0" + told.name.encode() + b"\xff" * 50)
    (cache / "RIHS01_x.cdr").mkdir()
    code, out, err = run("show", told.name)
    assert (code, out) == (1, "") and 'no package "nowhere_msgs"' in err and "Traceback" not in err


def test_the_search_path_comes_first_and_nothing_kept_is_the_usual_error(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(Told("std_msgs/msg/String", "string other"))
    _, out, err = run("show", "std_msgs/msg/String")
    assert out.endswith("string data\n") and err == ""
    for setting in ("/proc/nowhere", "off"):
        monkeypatch.setenv(VARIABLE, setting)
        code, _, err = run("show", "nowhere_msgs/msg/Kind")
        assert code == 1 and 'no package "nowhere_msgs"' in err
