"""--keep-going: one wrong definition does not take the others away, and says what goes with it."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.interface_packages import importable, write

from rosidl_py_gen.generator_cli import main

# One wrong file, one that needs it, one that needs that one, and 38 that have nothing to do with it.
WRONG = {
    **{f"a_msgs/msg/Right{number}.msg": "uint8 x\n" for number in range(38)},
    "a_msgs/msg/Wrong.msg": "uint8 fine\nfloat64 Bad 3\n",
    "a_msgs/msg/Uses.msg": "uint8 y\n# more\nWrong[] all\n",
    "b_msgs/srv/Ask.srv": "a_msgs/Right1 one\n---\na_msgs/Uses answer\n",
    "b_msgs/action/Do.action": "a_msgs/Right1 goal\n---\n---\n",
}


@dataclass(frozen=True)
class Answer:
    code: int
    out: str
    err: str


class Shell:
    """Runs the command line in a folder."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, *arguments: str) -> Answer:
        self.capsys.readouterr()
        code: object = 0
        try:
            main(list(arguments))
        except SystemExit as end:
            code = end.code
        assert isinstance(code, int)
        return Answer(code, *self.capsys.readouterr())


@pytest.fixture
def shell(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Shell:
    monkeypatch.chdir(tmp_path)
    for name in ("AMENT_PREFIX_PATH", "IDL_PACKAGE_FILTER"):
        monkeypatch.delenv(name, raising=False)
    write(tmp_path / "src", WRONG)
    return Shell(capsys)


WANTED = ("--path", "src", "--filter", "a_msgs:b_msgs", "--out", "out")
TOLD = [
    'src/a_msgs/msg/Uses.msg:3:1: a_msgs/msg/Uses needs a_msgs/msg/Wrong, which has problems',
    "    Wrong[] all",
    "    ^",
    'src/a_msgs/msg/Wrong.msg:2:9: "Bad" is not a field name; expected lower case letters, digits and single '
    "underscores, a letter first, no underscore last",
    "    float64 Bad 3",
    "            ^",
    "src/b_msgs/srv/Ask.srv:3:1: b_msgs/srv/Ask needs a_msgs/msg/Wrong, which has problems",
    "    a_msgs/Uses answer",
    "    ^",
]  # fmt: skip


def test_without_it_nothing_is_written_and_the_option_is_named(shell: Shell) -> None:
    answer = shell(*WANTED)
    assert (answer.code, answer.out, Path("out").exists()) == (1, "", False)
    assert answer.err.splitlines() == [
        *TOLD[3:6],
        "1 problem; nothing was written (--keep-going generates the valid interfaces)",
    ]


def test_what_is_right_is_written_and_the_rest_is_told(shell: Shell) -> None:
    answer = shell(*WANTED, "--keep-going")
    assert answer.code == 1
    assert answer.err.splitlines() == [*TOLD, "3 problems; interfaces with problems were skipped"]
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


def test_when_all_is_right_the_option_changes_nothing(shell: Shell) -> None:
    Path("src/a_msgs/msg/Wrong.msg").write_text("uint8 fine\n")
    plain = shell(*WANTED)
    again = shell(*WANTED, "--keep-going")
    assert (plain.code, again.code, again.err) == (0, 0, "")
    assert "0 files written, 0 removed" in again.out


def test_what_has_become_wrong_does_not_stay(shell: Shell) -> None:
    Path("src/a_msgs/msg/Wrong.msg").write_text("uint8 fine\n")
    shell(*WANTED)
    Path("src/a_msgs/msg/Wrong.msg").write_text("uint9 fine\n")
    stale = shell(*WANTED, "--keep-going", "--check")
    assert (stale.code, "would remove out/a_msgs/msg/_wrong.py" in stale.out) == (1, True)
    assert shell(*WANTED, "--keep-going").code == 1
    assert not Path("out/a_msgs/msg/_wrong.py").exists()
    assert not Path("out/b_msgs/srv").exists()
    assert Path("out/b_msgs/action/_do.py").exists()


def test_check_is_not_satisfied_while_something_is_wrong(shell: Shell) -> None:
    shell(*WANTED, "--keep-going")
    answer = shell(*WANTED, "--keep-going", "--check")
    assert (answer.code, "0 files would be written" in answer.out) == (1, True)


def test_json_has_both(shell: Shell) -> None:
    found = json.loads(shell(*WANTED, "--keep-going", "--json").out)
    assert "a_msgs/msg/Right0" in found["interfaces"]
    assert [(row["path"], row["line"], row["column"]) for row in found["errors"]] == [
        ("src/a_msgs/msg/Uses.msg", 3, 1),
        ("src/a_msgs/msg/Wrong.msg", 2, 9),
        ("src/b_msgs/srv/Ask.srv", 3, 1),
    ]


def test_nothing_right_is_a_plain_error(shell: Shell) -> None:
    answer = shell("--path", "src", "--filter", "a_msgs/msg/Wrong", "--out", "out", "--keep-going")
    assert (answer.code, answer.out, Path("out").exists()) == (1, "", False)
    assert answer.err.splitlines() == TOLD[3:6]


def test_a_name_that_stands_for_nothing_is_told_and_its_old_package_stays(shell: Shell) -> None:
    write(Path("src"), {"c_msgs/msg/C.msg": ""})
    shell("--path", "src", "--filter", "c_msgs", "--out", "out")
    Path("src/c_msgs").rename("elsewhere")
    answer = shell("--path", "src", "--filter", "a_msgs/msg/Right1:c_msgs", "--out", "out", "--keep-going")
    assert (answer.code, answer.err.splitlines()[0]) == (
        1,
        'c_msgs: no package; did you mean "b_msgs"? (searched: src, bundled)',
    )
    assert Path("out/a_msgs/msg/_right1.py").exists()
    assert Path("out/c_msgs/msg/_c.py").exists()


@pytest.mark.parametrize(
    ("files", "left_out"),
    [
        ({"c_msgs/msg/A.msg": "B b", "c_msgs/msg/B.msg": "A a", "c_msgs/msg/C.msg": ""}, {"A", "B"}),
        ({"c_msgs/msg/A.msg": "nowhere_msgs/X x", "c_msgs/msg/C.msg": ""}, {"A"}),
        ({"c_msgs/msg/lower.msg": "", "c_msgs/msg/C.msg": ""}, {"lower"}),
        ({"c_msgs/msg/A.msg": b"\xff", "c_msgs/msg/C.msg": ""}, {"A"}),
        (
            {"c_msgs/msg/A.msg": "Ask_Request x", "c_msgs/srv/Ask.srv": "uint9 x\n---\n", "c_msgs/msg/C.msg": ""},
            {"A", "Ask"},
        ),
        ({"c_msgs/msg/ABC.msg": "", "c_msgs/msg/Abc.msg": "", "c_msgs/msg/C.msg": ""}, {"Abc"}),
        ({"c_msgs/msg/C.msg": "", "numpy/msg/N.msg": ""}, {"N"}),
        ({"c_msgs/msg/C.msg": "", "Bad-name/msg/N.msg": ""}, {"N"}),
    ],
    ids=[
        "a circle",
        "an unknown package",
        "a file name",
        "bytes",
        "a derived message",
        "one module",
        "a taken name",
        "a package name",
    ],
)
def test_whatever_is_wrong_the_rest_is_generated(
    shell: Shell, files: dict[str, str | bytes], left_out: set[str]
) -> None:
    write(Path("more"), files)
    answer = shell("--path", "more", "--out", "out", "--keep-going", "--json")
    found = json.loads(answer.out)
    names = {name.split("/")[2] for name in found["interfaces"]}
    assert (answer.code, names & {*left_out, "C", "String"}) == (1, {"C", "String"})
    assert found["errors"]


def test_a_listed_file_that_is_missing_takes_nothing_else_away(shell: Shell) -> None:
    cmake = "rosidl_generate_interfaces(c_msgs msg/C.msg msg/Missing.msg ${unknown})"
    manifest = "<package><name>c_msgs</name></package>"
    write(Path("more/c_msgs"), {"msg/C.msg": "", "CMakeLists.txt": cmake, "package.xml": manifest})
    plain = shell("--path", "more", "--filter", "c_msgs", "--out", "out")
    assert (plain.code, Path("out").exists()) == (1, False)
    answer = shell("--path", "more", "--filter", "c_msgs", "--out", "out", "--keep-going")
    assert (answer.code, Path("out/c_msgs/msg/_c.py").exists()) == (1, True)
    note, problem = answer.err.splitlines()[:2]
    assert note.startswith("note: more/c_msgs/CMakeLists.txt:1:61: rosidl_generate_interfaces() has no list")
    assert problem.startswith('more/c_msgs/CMakeLists.txt:1:45: "msg/Missing.msg" is listed here')
    assert shell("check", "--path", "more", "c_msgs").err.splitlines()[:2] == [note, problem]


def test_check_reports_everything_anyway(shell: Shell) -> None:
    answer = shell("--keep-going", "check", "--path", "src")
    assert (answer.code, "--keep-going has no meaning for the command check" in answer.err) == (2, True)


def test_notes_reach_everybody_who_generates(shell: Shell) -> None:
    cmake = "rosidl_generate_interfaces(c_msgs ${unknown})"
    manifest = "<package><name>c_msgs</name></package>"
    write(Path("more/c_msgs"), {"msg/C.msg": "", "CMakeLists.txt": cmake, "package.xml": manifest})
    wanted = ("--path", "more", "--filter", "c_msgs", "--out", "out")
    answer = shell(*wanted)
    assert (answer.code, answer.err.count("note: "), Path("out/c_msgs/msg/_c.py").exists()) == (0, 1, True)
    (row,) = json.loads(shell(*wanted, "--json").out)["notes"]
    assert (row["path"], row["line"], row["column"]) == ("more/c_msgs/CMakeLists.txt", 1, 35)
    assert shell("check", "--path", "more", "c_msgs").err == answer.err
    assert shell("--path", "more", "--filter", "std_msgs", "--out", "other").err == ""
