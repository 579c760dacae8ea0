"""``--keep-going``: generates all interfaces that do not depend on a wrong definition."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from support.generator_shell import Shell
from support.interface_packages import importable, write

# One wrong file, one that needs it, one that needs that one, and 38 that have nothing to do with it.
WRONG = {
    **{f"a_msgs/msg/Right{number}.msg": "uint8 x\n" for number in range(38)},
    "a_msgs/msg/Wrong.msg": "uint8 fine\nfloat64 Bad 3\n",
    "a_msgs/msg/Uses.msg": "uint8 y\n# more\nWrong[] all\n",
    "b_msgs/srv/Ask.srv": "a_msgs/Right1 one\n---\na_msgs/Uses answer\n",
    "b_msgs/action/Do.action": "a_msgs/Right1 goal\n---\n---\n",
}


@pytest.fixture(autouse=True)
def source(shell: Shell) -> None:
    write(shell.folder / "src", WRONG)


ARGUMENTS = ("--path", "src", "--filter", "a_msgs:b_msgs", "--out", "out")
PROBLEMS = [
    'error: src/a_msgs/msg/Uses.msg:3:1: a_msgs/msg/Uses needs a_msgs/msg/Wrong, which has problems',
    "    Wrong[] all",
    "    ^",
    'error: src/a_msgs/msg/Wrong.msg:2:9: "Bad" is not a field name; expected lower case letters, digits and single '
    "underscores, a letter first, no underscore last",
    "    float64 Bad 3",
    "            ^",
    "error: src/b_msgs/srv/Ask.srv:3:1: b_msgs/srv/Ask needs a_msgs/msg/Wrong, which has problems",
    "    a_msgs/Uses answer",
    "    ^",
]  # fmt: skip


def test_without_keep_going_no_files_are_written_and_option_is_suggested(shell: Shell) -> None:
    answer = shell(*ARGUMENTS)
    assert (answer.code, answer.out, Path("out").exists()) == (1, "", False)
    assert answer.err.splitlines() == [
        *PROBLEMS[3:6],
        "1 problem; nothing was written (--keep-going generates the valid interfaces)",
    ]


def test_valid_interfaces_are_generated_and_invalid_ones_are_reported(shell: Shell) -> None:
    answer = shell(*ARGUMENTS, "--keep-going")
    assert answer.code == 1
    assert answer.err.splitlines() == [*PROBLEMS, "3 problems; interfaces with problems were skipped"]
    assert " interfaces in " in answer.out
    made = {path.name for path in Path("out").rglob("*.py")}
    assert {"_right0.py", "_right37.py", "_do.py"} <= made
    assert not made & {"_wrong.py", "_uses.py", "_ask.py"}
    with importable(Path("out")):
        from a_msgs.msg import Right37  # type: ignore[import-not-found]
        from b_msgs.action import Do  # type: ignore[import-not-found]

        assert Do.Goal(goal=sys.modules["a_msgs.msg"].Right1(x=3)).encode()
        assert Right37(x=1).encode()
        with pytest.raises(ImportError):
            from a_msgs.msg import Uses  # noqa: F401


def test_outputs_of_interfaces_that_became_invalid_are_removed(shell: Shell) -> None:
    Path("src/a_msgs/msg/Wrong.msg").write_text("uint8 fine\n")
    shell(*ARGUMENTS)
    Path("src/a_msgs/msg/Wrong.msg").write_text("uint9 fine\n")
    stale = shell(*ARGUMENTS, "--keep-going", "--check")
    assert (stale.code, "would remove out/a_msgs/msg/_wrong.py" in stale.out) == (1, True)
    assert shell(*ARGUMENTS, "--keep-going").code == 1
    assert shell(*ARGUMENTS, "--keep-going", "--check").code == 1
    assert not Path("out/a_msgs/msg/_wrong.py").exists()
    assert not Path("out/b_msgs/srv").exists()
    assert Path("out/b_msgs/action/_do.py").exists()


def test_selection_without_valid_interfaces_is_an_error(shell: Shell) -> None:
    answer = shell("--path", "src", "--filter", "a_msgs/msg/Wrong", "--out", "out", "--keep-going")
    assert (answer.code, answer.out, Path("out").exists()) == (1, "", False)
    assert answer.err.splitlines() == PROBLEMS[3:6]


def test_unknown_filter_name_is_reported_and_its_generated_package_is_kept(shell: Shell) -> None:
    write(Path("src"), {"c_msgs/msg/C.msg": ""})
    shell("--path", "src", "--filter", "c_msgs", "--out", "out")
    Path("src/c_msgs").rename("elsewhere")
    answer = shell("--path", "src", "--filter", "a_msgs/msg/Right1:c_msgs", "--out", "out", "--keep-going")
    assert (answer.code, answer.err.splitlines()[0]) == (
        1,
        'error: c_msgs: no package; did you mean "b_msgs"? (searched: src, bundled)',
    )
    assert Path("out/a_msgs/msg/_right1.py").exists()
    assert Path("out/c_msgs/msg/_c.py").exists()


BROKEN: dict[str, tuple[dict[str, str | bytes], set[str]]] = {
    "a circle": ({"c_msgs/msg/A.msg": "B b", "c_msgs/msg/B.msg": "A a"}, {"A", "B"}),
    "an unknown package": ({"c_msgs/msg/A.msg": "nowhere_msgs/X x"}, {"A"}),
    "a file name": ({"c_msgs/msg/lower.msg": ""}, {"lower"}),
    "bytes": ({"c_msgs/msg/A.msg": b"\xff"}, {"A"}),
    "a derived message": ({"c_msgs/msg/A.msg": "Ask_Request x", "c_msgs/srv/Ask.srv": "uint9 x\n---\n"}, {"A", "Ask"}),
    "one module": ({"c_msgs/msg/ABC.msg": "", "c_msgs/msg/Abc.msg": ""}, {"Abc"}),
    "a taken name": ({"numpy/msg/N.msg": ""}, {"N"}),
    "a package name": ({"Bad-name/msg/N.msg": ""}, {"N"}),
}


@pytest.mark.parametrize("case", BROKEN)
def test_valid_interfaces_are_generated_next_to_broken_ones(shell: Shell, case: str) -> None:
    files, skipped = BROKEN[case]
    write(Path("more"), {"c_msgs/msg/C.msg": "", **files})
    answer = shell("--path", "more", "--out", "out", "--keep-going", "--json")
    names = {name.split("/")[2] for name in answer.json["interfaces"]}
    assert (answer.code, names & {*skipped, "C", "String"}) == (1, {"C", "String"})
    assert answer.json["errors"]


def test_missing_listed_file_does_not_block_other_interfaces(shell: Shell) -> None:
    cmake = "rosidl_generate_interfaces(c_msgs msg/C.msg msg/Missing.msg)"
    manifest = "<package><name>c_msgs</name></package>"
    write(Path("more/c_msgs"), {"msg/C.msg": "", "CMakeLists.txt": cmake, "package.xml": manifest})
    plain = shell("--path", "more", "--filter", "c_msgs", "--out", "out")
    assert (plain.code, Path("out").exists()) == (1, False)
    answer = shell("--path", "more", "--filter", "c_msgs", "--out", "out", "--keep-going")
    assert (answer.code, Path("out/c_msgs/msg/_c.py").exists()) == (1, True)
    problem = answer.err.splitlines()[0]
    assert problem.startswith('error: more/c_msgs/CMakeLists.txt:1:45: "msg/Missing.msg" is listed here')
    assert shell("check", "--path", "more", "c_msgs").err.splitlines()[0] == problem


def test_missing_file_in_unresolvable_cmake_list_is_no_error(shell: Shell) -> None:
    cmake = "rosidl_generate_interfaces(c_msgs msg/C.msg msg/Missing.msg ${unknown})"
    manifest = "<package><name>c_msgs</name></package>"
    write(Path("more/c_msgs"), {"msg/C.msg": "", "CMakeLists.txt": cmake, "package.xml": manifest})
    answer = shell("--path", "more", "--filter", "c_msgs", "--out", "out")
    assert (answer.code, Path("out/c_msgs/msg/_c.py").exists()) == (0, True)
    (note,) = [line for line in answer.err.splitlines() if line.startswith("note: ")]
    assert note.startswith("note: more/c_msgs/CMakeLists.txt:1:61: rosidl_generate_interfaces() has no list")


def test_notes_are_printed_by_generate_json_and_check(shell: Shell) -> None:
    cmake = "rosidl_generate_interfaces(c_msgs ${unknown})"
    manifest = "<package><name>c_msgs</name></package>"
    write(Path("more/c_msgs"), {"msg/C.msg": "", "CMakeLists.txt": cmake, "package.xml": manifest})
    arguments = ("--path", "more", "--filter", "c_msgs", "--out", "out")
    answer = shell(*arguments)
    assert (answer.code, answer.err.count("note: "), Path("out/c_msgs/msg/_c.py").exists()) == (0, 1, True)
    (row,) = shell(*arguments, "--json").json["notes"]
    assert (row["path"], row["line"], row["column"]) == ("more/c_msgs/CMakeLists.txt", 1, 35)
    assert shell("check", "--path", "more", "c_msgs").err == answer.err
    assert shell("--path", "more", "--filter", "std_msgs", "--out", "other").err == ""
