"""Command lines of users who have not read the help: they work, or the error names the fix."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.interface_packages import write

from rosidl_py_gen import DefinitionError
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path

FILES = {"a_msgs/msg/A.msg": "int32 x\n", "b_msgs/msg/B.msg": "int99 y\n"}


def command(*arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rosidl_py_gen.generator_cli", *arguments],
        cwd=cwd,
        env={**os.environ, "AMENT_PREFIX_PATH": "", "IDL_PACKAGE_FILTER": "", **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def source(tmp_path: Path) -> Path:
    return write(tmp_path / "src", FILES)


def test_options_before_a_command_count(source: Path, tmp_path: Path) -> None:
    found = command("--path", str(source), "check", cwd=tmp_path)
    assert (found.returncode, "int99" in found.stderr) == (1, True)
    assert '"errors"' in command("--json", "check", "--path", str(source), cwd=tmp_path).stdout


def test_check_takes_the_filter_of_the_environment(source: Path, tmp_path: Path) -> None:
    found = command("check", "--path", str(source), cwd=tmp_path, IDL_PACKAGE_FILTER="a_msgs")
    assert found.stdout == "1 interfaces in 1 packages: no problems\n"


@pytest.mark.parametrize("option", [("--out", "x"), ("--check",), ("--list",), ("--filter", "a_msgs")])
def test_options_that_mean_nothing_for_a_command_are_refused(option: tuple[str, ...], tmp_path: Path) -> None:
    found = command(*option, "interface", "std_msgs/msg/String", cwd=tmp_path)
    assert found.returncode == 2
    assert f"{option[0]} has no meaning for the command interface" in found.stderr


def test_a_package_name_as_command_points_to_the_filter(tmp_path: Path) -> None:
    found = command("std_msgs", cwd=tmp_path)
    assert (found.returncode, "--filter std_msgs" in found.stderr) == (2, True)


def test_what_has_no_definition_any_more_is_removed(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ("--path", str(source), "--out", str(out), "--filter", "a_msgs")
    command(*arguments, cwd=tmp_path)
    mine = out / "a_msgs" / "notes.txt"
    mine.write_text("keep")
    (source / "a_msgs" / "msg" / "A.msg").unlink()
    assert command(*arguments, "--check", cwd=tmp_path).returncode == 1
    assert command(*arguments, cwd=tmp_path).returncode == 0
    assert [path for path in (out / "a_msgs").rglob("*") if path.is_file()] == [mine]


def test_a_package_that_is_gone_is_removed_by_a_run_for_everything(source: Path, tmp_path: Path) -> None:
    shutil.rmtree(source / "b_msgs")
    out = tmp_path / "out"
    arguments = ("--path", str(source), "--out", str(out))
    write(source, {"c_msgs/msg/C.msg": "int8 z\n"})
    command(*arguments, cwd=tmp_path)
    assert (out / "c_msgs" / "msg" / "_c.py").exists()
    shutil.rmtree(source / "c_msgs")
    command(*arguments, cwd=tmp_path)
    assert not (out / "c_msgs").exists()
    assert (out / "a_msgs" / "msg" / "_a.py").exists()


def test_an_illegal_package_bothers_only_who_asks_for_it(tmp_path: Path) -> None:
    source = write(tmp_path / "src", {"my-driver/msg/A.msg": "int8 x\n", "ok_msgs/msg/B.msg": "int8 x\n"})
    assert command("check", "ok_msgs", "--path", str(source), cwd=tmp_path).returncode == 0
    found = command("check", "my-driver", "--path", str(source), cwd=tmp_path)
    assert (found.returncode, '"my-driver" is not a legal package name' in found.stderr) == (1, True)


def test_a_group_of_packages_may_be_called_msg(tmp_path: Path) -> None:
    source = write(
        tmp_path / "src",
        {"msg/x_msgs/msg/A.msg": "int8 x\n", "msg/x_msgs/package.xml": "<package><name>x_msgs</name></package>"},
    )
    assert command("check", "x_msgs", "--path", str(source), cwd=tmp_path).returncode == 0


def test_definitions_cannot_steer_the_terminal(tmp_path: Path) -> None:
    source = write(tmp_path / "src", {"a_msgs/msg/A.msg": "int32 \x1b]0;title\x07\n"})
    found = command("check", "--path", str(source), cwd=tmp_path)
    assert found.returncode == 1
    assert "\x1b" not in found.stderr


def test_a_file_in_the_way_is_named_once(source: Path, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    found = command("--path", str(source), "--filter", "a_msgs", "--out", "taken", cwd=tmp_path)
    assert (found.returncode, found.stderr.count("taken is a file")) == (1, 1)


def test_an_unreadable_folder_is_an_error(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    search = scan_search_path([source], ament="", bundled=False)
    real = os.scandir

    def refuse(folder: Path) -> object:
        if str(folder).endswith("a_msgs/msg"):
            raise PermissionError(13, "Permission denied", str(folder))
        return real(folder)

    monkeypatch.setattr(os, "scandir", refuse)  # permissions mean nothing to root, who runs CI
    with pytest.raises(DefinitionError, match="a_msgs/msg: the folder cannot be read: Permission denied"):
        _ = search.packages["a_msgs"].files


def test_derived_messages_have_interfaces(tmp_path: Path) -> None:
    assert "RIHS01_" in command("interface", "std_srvs/srv/SetBool_Request", cwd=tmp_path).stdout


def test_what_was_generated_below_the_path_is_not_taken_for_a_package(tmp_path: Path) -> None:
    package = "<package><name>robot_msgs</name></package>"
    listing = "find_package(rosidl_default_generators)\nfile(GLOB files RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} msg/*)\n"
    listing += "rosidl_generate_interfaces(robot_msgs ${files})\n"
    files = {"package.xml": package, "CMakeLists.txt": listing, "msg/A.msg": "int8 x"}
    write(tmp_path, {f"src/robot_msgs/{name}": text for name, text in files.items()})
    for out in ("generated", "generated", "src", "src"):  # beside the definitions, and among them
        made = command("--path", ".", "--filter", "robot_msgs", "--out", out, cwd=tmp_path)
        assert (made.returncode, made.stdout[:27]) == (0, "1 interfaces in 1 packages:"), made.stderr
