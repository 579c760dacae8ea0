"""``rosidl-py interface``: definitions, prototypes and hashes, also of types that a node described once."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from each_case import each_case
from support.announced_types import Told, fresh, told_by
from support.worlds import World

from rosidl_py_gen import from_dict, get_action, get_message, get_service, type_hash
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.resources import DataFolders
from rosidl_py_gen.cdr.codec import encode
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.ros_cli.message_text import message_from
from rosidl_py_gen.type_loading.disk_cache import VARIABLE, CachedDescription

if TYPE_CHECKING:
    from collections.abc import Callable

    Run = Callable[..., str]
    RunHere = Callable[..., tuple[int, str, str]]


_PACKAGES = SearchPath.scan([DataFolders.interfaces()], ament="", bundled=False).packages.values()
BUNDLED = [str(name) for package in _PACKAGES for name in package.files]


@pytest.fixture
def command(run_here: RunHere) -> RunHere:
    """Runs a command of the group."""
    return partial(run_here, "interface")


@pytest.fixture
def run(command: RunHere) -> Run:
    """Runs a command of the group, which has to end well; gives what it prints."""

    def call(*arguments: str) -> str:
        code, out, err = command(*arguments)
        assert code == 0, err
        return out

    return call


def workspace(folder: Path, **files: str) -> str:
    """A package ``my_msgs`` with these files, named as ``msg__Name__msg``."""
    for name, text in files.items():
        kind, stem, suffix = name.split("__")
        path = folder / "my_msgs" / kind / f"{stem}.{suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return str(folder)


def test_show_expands_nested_types_below_their_fields(run: Run) -> None:
    assert run("show", "--no-comments", "geometry_msgs/msg/PointStamped") == (
        "std_msgs/Header header\n\tbuiltin_interfaces/Time stamp\n\t\tint32 sec\n\t\tuint32 nanosec\n"
        "\tstring frame_id\nPoint point\n\tfloat64 x\n\tfloat64 y\n\tfloat64 z\n"
    )


def test_show_prints_nested_comments_only_with_all_comments(run: Run, tmp_path: Path) -> None:
    path = workspace(
        tmp_path, msg__Inner__msg="# inner\n\nint8 x # of x\n", msg__Outer__msg="# outer\n\nInner a # of a"
    )
    plain = run("show", "my_msgs/msg/Outer", "--path", path)
    assert plain == "# outer\n\nInner a # of a\n\tint8 x\n"
    everything = run("show", "my_msgs/msg/Outer", "--path", path, "--all-comments")
    assert everything == "# outer\n\nInner a # of a\n\t# inner\n\t\n\tint8 x # of x\n"


def test_show_keeps_the_sections_of_services_and_actions(run: Run) -> None:
    assert run("show", "--no-comments", "std_srvs/srv/SetBool") == "bool data\n---\nbool success\nstring message\n"
    text = run("show", "--no-comments", "example_interfaces/action/Fibonacci")
    assert text == "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n"


def test_show_prints_idl_and_derived_messages_in_msg_format(run: Run, tmp_path: Path) -> None:
    idl = (
        "module my_msgs { module msg {\n module Speed_Constants { const uint8 FAST = 3; };\n"
        ' @verbatim(language="comment", text="How fast.")\n'
        ' struct Speed {\n  @default(value=2.5) @unit(value="m/s") double value;\n  sequence<int32, 4> last; };\n}; };'
    )
    path = workspace(tmp_path, msg__Speed__idl=idl)
    lines = run("show", "my_msgs/msg/Speed", "--path", path).splitlines()
    assert lines == ["# How fast.", "uint8 FAST=3", "# [m/s]", "float64 value 2.5", "int32[<=4] last"]
    assert "bool data\n" in run("show", "std_srvs/srv/SetBool_Request")


def test_exponentially_nested_types_are_refused(command: RunHere, tmp_path: Path) -> None:
    files = {f"msg__L{level}__msg": f"L{level + 1} a\nL{level + 1} b\n" for level in range(40)}
    path = workspace(tmp_path, **files, msg__L40__msg="int8 x\n")
    assert "more than 20000 lines" in command("show", "my_msgs/msg/L24", "--path", path)[2]
    assert "at most 1048576 are allowed" in command("show", "my_msgs/msg/L0", "--path", path)[2]


def test_types_can_be_selected_by_unique_short_name(run: Run, command: RunHere) -> None:
    assert run("show", "Fibonacci") == run("show", "example_interfaces/Fibonacci")
    assert run("hash", "Fibonacci").endswith("  example_interfaces/action/Fibonacci\n")
    assert '"SetBool" may be example_interfaces/srv/SetBool, std_srvs/srv/SetBool' in command("show", "SetBool")[2]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("show", "std_msgs/msg/Strin"), 'did you mean "std_msgs/msg/String"?'),
        (("proto", "std_mgs/msg/String"), 'no package "std_mgs" for std_mgs/msg/String; did you mean "std_msgs"?'),
        (("hash", "a/b/c/d"), '"a/b/c/d" is not an interface name'),
        (("list", "std_mgs"), 'no package std_mgs; did you mean "std_msgs"?'),
        (("package", "nowhere"), "no package nowhere (searched: "),
        (("packages", "--path", "no/folder"), "no/folder: expected a folder"),
    ],
)
def test_invalid_names_and_paths_are_reported(arguments: tuple[str, ...], reason: str, command: RunHere) -> None:
    code, _, err = command(*arguments)
    assert code == 1 and reason in err


def test_invalid_definition_is_reported_with_line(command: RunHere, tmp_path: Path) -> None:
    path = workspace(tmp_path, msg__Bad__msg="int8 x\nHeder h\n")
    assert "Bad.msg:2:1: unknown type" in command("show", "my_msgs/msg/Bad", "--path", path)[2]


@pytest.mark.slow
@each_case("name", BUNDLED)
def test_prototype_of_every_bundled_type_parses_to_default_message(name: str, run: Run) -> None:
    cls = get_message(name + {"msg": "", "srv": "_Request", "action": "_Goal"}[name.split("/")[1]])
    (word,) = shlex.split(run("proto", name))
    assert message_from(cls, word) == cls()


def test_prototypes_can_be_printed_without_quotes_and_as_json(run: Run) -> None:
    cls = get_message("sensor_msgs/msg/Imu")
    assert message_from(cls, run("proto", "--no-quotes", "sensor_msgs/msg/Imu")) == cls()
    assert from_dict(cls, json.loads(run("proto", "--json", "sensor_msgs/msg/Imu"))) == cls()


@pytest.mark.slow
@pytest.mark.parametrize("default", ["it's", 'say "no"', "$HOME `id` \\ !", "a: b", "-", "ünï", "1", "null", "~"])
def test_prototypes_survive_a_shell_and_yaml(default: str, run: Run, tmp_path: Path) -> None:
    quoted = '"' + default.replace("\\", "\\\\").replace('"', '\\"') + '"'
    path = workspace(tmp_path, msg__Text__msg=f"string data {quoted}\n")
    line = run("proto", "my_msgs/msg/Text", "--path", path)
    echoed = subprocess.run(["sh", "-c", f"printf %s {line}"], capture_output=True, text=True, check=True).stdout
    cls = get_message("my_msgs/msg/Text", path=path)
    assert message_from(cls, echoed) == cls() and cls().data == default  # type: ignore[attr-defined]


def test_hash_equals_type_hash_of_class_and_its_derived_types(run: Run) -> None:
    service, action = get_service("std_srvs/srv/SetBool"), get_action("example_interfaces/action/Fibonacci")
    found = json.loads(run("hash", "--parts", "--json", "std_srvs/srv/SetBool", "example_interfaces/action/Fibonacci"))
    assert len(found) == 1 + 3 + 1 + 12
    assert found["std_srvs/srv/SetBool"] == type_hash(service)
    assert found["std_srvs/srv/SetBool_Event"] == type_hash(service.Event)  # type: ignore[attr-defined]
    assert found["example_interfaces/action/Fibonacci"] == type_hash(action)
    assert found["example_interfaces/action/Fibonacci_GetResult"] == type_hash(action.GetResult)  # type: ignore[attr-defined]
    assert run("hash", "std_msgs/msg/String") == (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18  std_msgs/msg/String\n"
    )


def test_list_and_package_print_types_of_search_path(run: Run, tmp_path: Path) -> None:
    path = workspace(tmp_path, msg__A__msg="int8 x", srv__B__srv="---")
    assert run("list", "my_msgs", "--path", path) == (
        "Messages:\n    my_msgs/msg/A\nServices:\n    my_msgs/srv/B\nActions:\n"
    )
    assert run("list", "my_msgs", "-s", "--path", path) == "Services:\n    my_msgs/srv/B\n"
    assert run("package", "my_msgs", "--path", path) == "my_msgs/msg/A\nmy_msgs/srv/B\n"
    assert json.loads(run("list", "--json")) == BUNDLED
    assert json.loads(run("packages", "-s", "--json", "--path", path)).count({"name": "my_msgs", "origin": path}) == 1
    assert "my_msgs" not in run("packages", "-a", "--path", path)


@pytest.mark.slow
def test_type_name_comes_from_standard_input(command: RunHere) -> None:
    code, out, _ = command("show", "-", stdin="std_msgs/msg/Bool\n")
    assert (code, out.splitlines()[-1][:9]) == (0, "bool data")
    code, _, err = command("show", "-")
    assert code == 1 and "found nothing" in err


@pytest.mark.slow
def test_without_the_extra_node_show_works_and_other_commands_name_it() -> None:
    code = (
        "import sys\n"
        "for name in ('cyclonedds', 'zenoh', 'rich', 'yaml'): sys.modules[name] = None\n"
        "from rosidl_py_gen.runtime.transport.cyclone import library\n"
        "library.candidates = lambda environ: iter(())\n"
        "from rosidl_py_gen.ros_cli import main\n"
        "main(sys.argv[1:])"
    )

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)

    assert run("interface", "show", "std_msgs/msg/String").returncode == 0
    assert run("interface", "proto", "--json", "std_msgs/msg/String").stdout == '{"data": ""}\n'
    for needs in (("interface", "proto", "std_msgs/msg/String"), ("topic", "list", "--discovery", "localhost")):
        done = run(*needs)
        assert done.returncode == 1 and Extra("node").install_command() in done.stderr, done.stderr
        assert "Traceback" not in done.stderr


POINT = "nowhere_msgs/msg/Inner"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def cached_command(command: RunHere, cache: Path) -> RunHere:
    return command


def cache_description(described: Told, *parts: str, sources: bool = True) -> None:
    for part in parts or ("",):
        name = described.name + part
        answer = described.answer(name if part else "", sources=sources)
        CachedDescription(described.library.type_hash(name)).store(encode(answer))


async def test_cached_description_of_node_is_shown_later(memory: World, cached_command: RunHere) -> None:
    described = fresh("# how fast\nfloat64 speed 1.5\nint32 MOST=7")
    node = memory.node()
    told_by(memory, described)
    await node.resolve_type("/t", timeout_s=10)
    memory.close()
    code, out, err = cached_command("show", described.name)
    assert (code, out) == (0, "# how fast\nfloat64 speed 1.5\nint32 MOST=7\n")
    assert err == f"{described.name} is not on the search path; using the cached definition {described.hash}\n"
    assert cached_command("show", described.name.replace("/msg/", "/"))[1] == out
    assert cached_command("hash", described.name)[1] == f"{described.hash}  {described.name}\n"
    assert json.loads(cached_command("proto", "--json", described.name)[1]) == {"speed": 1.5}
    assert json.loads(cached_command("show", "--json", described.name)[1])["hash"] == described.hash


def test_nested_type_is_found_in_cached_description_of_outer_type(cached_command: RunHere) -> None:
    described = fresh("Inner[] inner", **{POINT: "int8 x\nint8 y"})
    cache_description(described)
    assert cached_command("show", described.name)[1] == "Inner[] inner\n\tint8 x\n\tint8 y\n"
    assert cached_command("show", POINT)[1] == "int8 x\nint8 y\n"


@pytest.mark.parametrize(
    ("kind", "text", "parts"),
    [
        ("srv", "int8 a\n---\nint8 b", []),
        ("srv", "int8 a\n---\nint8 b", ["_Request", "_Response"]),
        (
            "action",
            "int8 a\n---\nint8 b\n---\nint8 c",
            ["_SendGoal_Request", "_GetResult_Response", "_FeedbackMessage"],
        ),
    ],
)
def test_cached_parts_are_combined_to_services_and_actions(
    cached_command: RunHere, kind: str, text: str, parts: list[str]
) -> None:
    described = fresh(text, kind)
    cache_description(described, *parts)
    code, out, err = cached_command("show", described.name)
    assert (code, out) == (0, text + "\n"), err
    assert json.loads(cached_command("proto", "--json", described.name)[1]) == {"a": 0}
    assert cached_command("hash", described.name)[1] == f"{described.hash}  {described.name}\n"


def test_newest_cached_definition_is_shown_and_others_are_named(cached_command: RunHere, cache: Path) -> None:
    old = fresh("int8 x")
    new = Told(old.name, "int8 x\nint8 y")
    for age, described in enumerate((old, new)):
        cache_description(described)
        os.utime(cache / f"{described.hash}.cdr", (age, age))
    _, out, err = cached_command("show", old.name)
    assert out == "int8 x\nint8 y\n"
    assert err.endswith(f"{new.hash}; other cached definitions: {old.hash}\n")


def test_parts_of_different_cached_definitions_are_not_combined(cached_command: RunHere) -> None:
    old = fresh("int8 a\n---\nint8 b", "srv")
    new = Told(old.name, "int8 a2\n---\nint8 b")
    cache_description(old, "_Request", "_Response")
    cache_description(new, "_Request")
    code, out, err = cached_command("show", old.name)
    assert (code, out) == (1, "")
    assert f"several definitions of {old.name}_Request" in err


def test_modified_cache_files_are_ignored(cached_command: RunHere, cache: Path) -> None:
    described, other = fresh(), fresh("int8 z")
    cache_description(described)
    (cache / f"{described.hash}.cdr").write_bytes(encode(Told(described.name, "int8 evil").answer()))
    (cache / f"{other.hash}.cdr").write_bytes(b"\0\1\0\0" + described.name.encode() + b"\xff" * 50)
    (cache / "RIHS01_x.cdr").mkdir()
    code, out, err = cached_command("show", described.name)
    assert (code, out) == (1, "") and 'no package "nowhere_msgs"' in err and "Traceback" not in err


def test_search_path_precedes_cached_definitions(cached_command: RunHere, monkeypatch: pytest.MonkeyPatch) -> None:
    cache_description(Told("std_msgs/msg/String", "string other"))
    _, out, err = cached_command("show", "std_msgs/msg/String")
    assert out.endswith("string data\n") and err == ""
    for setting in ("/proc/nowhere", "off"):
        monkeypatch.setenv(VARIABLE, setting)
        code, _, err = cached_command("show", "nowhere_msgs/msg/Kind")
        assert code == 1 and 'no package "nowhere_msgs"' in err
