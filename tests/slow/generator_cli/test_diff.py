"""``rosidl-py-gen diff`` with every kind of source: output and exit codes."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from support.generator_shell import Answer, Shell
from support.interface_packages import write

from rosidl_py_gen import compile_definition, get_service, type_hash, type_name
from rosidl_py_gen.bags import BagTopic, BagWriter

if TYPE_CHECKING:
    from collections.abc import Mapping

WHEEL = "my_msgs/msg/Wheel.msg"
BEFORE = {
    "my_msgs/package.xml": "<package><name>my_msgs</name></package>",
    WHEEL: "uint8 MAX=3\nfloat64 speed 0.5 # [m/s]\nstring<=8 name\n",
    "my_msgs/msg/Robot.msg": "Wheel[4] wheels\n",
    "my_msgs/srv/Turn.srv": "Wheel wheel\n---\nbool ok\n",
    "my_msgs/action/Drive.action": "float64 way\n---\nfloat64 rest\n---\nWheel wheel\n",
}


def after(changes: Mapping[str, str]) -> dict[str, str]:
    return BEFORE | {name if "." in name else f"my_msgs/msg/{name}.msg": text for name, text in changes.items()}


def diff(shell: Shell, changes: Mapping[str, str], *options: str) -> Answer:
    write(shell.folder / "old", BEFORE)
    write(shell.folder / "new", after(changes))
    return shell("diff", "old", "new", *options)


def git(folder: Path, *arguments: str) -> str:
    named = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "init.defaultBranch=main")
    return subprocess.run(["git", *named, *arguments], cwd=folder, check=True, capture_output=True, text=True).stdout


def repository(folder: Path, files: Mapping[str, str | bytes], message: str = "one") -> Path:
    write(folder, files)
    if not (folder / ".git").exists():
        git(folder, "init", "-q")
    git(folder, "add", "-A")
    git(folder, "commit", "-q", "--allow-empty", "-m", message)
    return folder


# --- what changed -----------------------------------------------------------------------------------------------------


def test_comment_changes_are_no_difference(shell: Shell) -> None:
    answer = diff(shell, {WHEEL: BEFORE[WHEEL] + "# more words\n"})
    assert answer.code == 0
    assert answer.out == "0 changed, 0 added, 0 removed, 4 unchanged; not breaking\n"


def test_every_change_of_a_type_is_reported_with_location(shell: Shell) -> None:
    answer = diff(shell, {"Wheel": "uint8 MAX=4\nfloat32 speed 0.7 # [rpm]\nstring<=8 label\nint8 more\n"})
    assert answer.code == 1
    _, _, document = answer.out.partition("\n~ my_msgs/msg/Wheel\n")
    lines = [line.strip() for line in document.partition("\n~ ")[0].splitlines()]
    assert lines[2:] == [
        "field     ~ speed: float64 -> float32  (new/my_msgs/msg/Wheel.msg:2:9)",
        "field     ~ speed: default 0.5 -> 0.7  (new/my_msgs/msg/Wheel.msg:2:9)",
        "field     ~ speed: unit m/s -> rpm  (new/my_msgs/msg/Wheel.msg:2:9)",
        "field     ~ label: was name, probably  (new/my_msgs/msg/Wheel.msg:3:11)",
        "field     + more: int8  (new/my_msgs/msg/Wheel.msg:4:6)",
        "constant  ~ MAX: uint8 3 -> uint8 4  (new/my_msgs/msg/Wheel.msg:1:7)",
        "old data  not read as before",
        "changes with it: my_msgs/action/Drive, my_msgs/msg/Robot, my_msgs/srv/Turn",
    ]
    assert answer.out.endswith(
        "4 changed, 0 added, 0 removed, 0 unchanged; changes of addition, code, data, default, hash, unit; "
        "breaking: code, data\n"
    )


def test_json_contains_both_hashes_and_dependent_types(shell: Shell) -> None:
    document = diff(shell, {"Wheel": "uint8 MAX=3\nfloat64 speed 0.5\nstring<=8 name\nint8 more\n"}, "--json").json
    by_name = {one["name"]: one for one in document["changed"]}
    assert [*by_name] == ["my_msgs/action/Drive", "my_msgs/msg/Robot", "my_msgs/msg/Wheel", "my_msgs/srv/Turn"]
    wheel = by_name["my_msgs/msg/Wheel"]
    assert wheel["used_by"] == ["my_msgs/action/Drive", "my_msgs/msg/Robot", "my_msgs/srv/Turn"]
    assert wheel["messages"][0]["reads_old_data"] is False
    assert wheel["messages"][0]["fields"] == [
        {
            "what": "added",
            "name": "more",
            "before": "",
            "after": "int8",
            "place": "new/my_msgs/msg/Wheel.msg:4:6",
            "sort": "addition",
        }
    ]
    robot = by_name["my_msgs/msg/Robot"]
    assert robot["old_hash"].startswith("RIHS01_") and robot["old_hash"] != robot["new_hash"]
    assert robot["messages"][0]["contains"] == ["my_msgs/msg/Wheel"] and robot["messages"][0]["fields"] == []
    assert robot["messages"][0]["reads_old_data"] is False
    assert [one["name"] for one in by_name["my_msgs/srv/Turn"]["messages"]] == ["my_msgs/srv/Turn_Request"]
    assert [one["name"] for one in by_name["my_msgs/action/Drive"]["messages"]] == ["my_msgs/action/Drive_Feedback"]
    assert document["breaking"] == ["data"] and document["sorts"] == ["addition", "data", "hash"]


def test_added_types_are_compatible_and_removed_types_are_breaking(shell: Shell) -> None:
    answer = diff(shell, {"my_msgs/msg/New.msg": "int8 a"})
    assert (answer.code, answer.out.splitlines()[0]) == (0, "+ my_msgs/msg/New")
    assert shell("diff", "old", "new", "--fail-on", "addition").code == 1
    answer = shell("diff", "new", "old")
    assert (answer.code, answer.out.splitlines()[0]) == (1, "- my_msgs/msg/New")


SORTS = [
    ("uint8 MAX=3\nfloat64 speed 0.5 # [m/s]\nstring<=8 name\n# words", []),
    ("uint8 MAX=3\nfloat64 speed 0.5 # [rad/s]\nstring<=8 name\n", ["unit"]),
    ("uint8 MAX=3\nfloat64 speed 0.6 # [m/s]\nstring<=8 name\n", ["default"]),
    ("uint8 MAX=3\nuint8 MIN=1\nfloat64 speed 0.5 # [m/s]\nstring<=8 name\n", ["addition"]),
    ("float64 speed 0.5 # [m/s]\nstring<=8 name\n", ["code"]),
    ("int8 MAX=3\nfloat64 speed 0.5 # [m/s]\nstring<=8 name\n", ["code"]),
    ("uint8 MAX=3\nfloat64 speed 0.5 # [m/s]\nstring<=9 name\n", ["hash"]),
    ("uint8 MAX=3\nfloat64 speed 0.5 # [m/s]\nstring<=7 name\n", ["code", "data", "hash"]),
    ("uint8 MAX=3\nstring<=8 name\nfloat64 speed 0.5 # [m/s]\n", ["data", "hash"]),
    ("uint8 MAX=3\nfloat64 speed 0.5 # [m/s]\n", ["code", "data", "hash"]),
]


@pytest.mark.parametrize(("text", "sorts"), SORTS)
def test_changes_are_classified_and_fail_on_selects_exit_code(shell: Shell, text: str, sorts: list[str]) -> None:
    selection = ("--filter", "my_msgs/Wheel")
    document = diff(shell, {"Wheel": text}, "--json", *selection).json
    assert document["sorts"] == sorts
    assert document["breaking"] == [sort for sort in sorts if sort in ("data", "code")]
    others = {"data", "code", "hash", "default", "unit", "addition"} - {*sorts}
    for kinds, code in ((others, 0), (sorts[-1:], 1), (["any"], int(bool(sorts))), (["nothing"], 0)):
        options = [word for kind in kinds for word in ("--fail-on", kind)]
        assert not kinds or shell("diff", "old", "new", *selection, *options).code == code


def test_minimal_number_of_fields_is_reported_as_moved(shell: Shell) -> None:
    files = {"a_msgs/msg/A.msg": "\n".join(f"int8 {name}" for name in "abcdef")}
    write(shell.folder / "old", files)
    write(shell.folder / "new", {"a_msgs/msg/A.msg": "\n".join(f"int8 {name}" for name in "bcdaef")})
    document = shell("diff", "old", "new", "--json").json
    fields = document["changed"][0]["messages"][0]["fields"]
    assert [(one["what"], one["name"], one["before"], one["after"]) for one in fields] == [("moved", "a", "1", "4")]


# --- git --------------------------------------------------------------------------------------------------------------


def test_git_revision_is_compared_at_folder_of_other_source(shell: Shell) -> None:
    repository(shell.folder, {f"src/{name}": text for name, text in BEFORE.items()} | {"other.py": "x"})
    (shell.folder / "src" / WHEEL).write_text("uint8 MAX=3\nfloat64 speed 0.5 # [m/s]\n")
    for old in ("HEAD", "main", "git:HEAD", "HEAD:src", "HEAD:./src"):
        answer = shell("diff", old, "src", "--filter", "my_msgs/Wheel")
        assert answer.code == 1, answer.err
        assert (
            f"field     - name: string<=8  ({old.removeprefix('git:').partition(':')[0]}:src/my_msgs/msg/Wheel"
            in answer.out
        )
    repository(shell.folder, {}, "two")
    assert shell("diff", "HEAD~1", "HEAD").code == 1
    assert shell("diff", "HEAD^{/two}", "src").code == 0
    assert shell("diff", "HEAD", "src").out.startswith("0 changed")


def test_package_missing_in_revision_is_reported_as_new(shell: Shell) -> None:
    repository(shell.folder, {"README": ""})
    write(shell.folder / "src", BEFORE)
    answer = shell("diff", "HEAD", "src")
    assert answer.code == 0 and "note: HEAD:src does not exist: all definitions are new" in answer.err
    assert answer.out.startswith("+ my_msgs/action/Drive\n")
    answer = shell("diff", "HEAD:src", "src")
    assert answer.code == 1 and answer.err == "error: HEAD:src: there is no such folder in this revision\n"


def test_invalid_definition_in_revision_is_reported_with_revision(shell: Shell) -> None:
    repository(shell.folder, {"src/a_msgs/msg/A.msg": "flaot32 x\n"})
    write(shell.folder, {"src/a_msgs/msg/A.msg": "float32 x\n"})
    answer = shell("diff", "HEAD", "src")
    assert answer.code == 1 and "HEAD:src/a_msgs/msg/A.msg:1:1: " in answer.err
    repository(shell.folder, {}, "right")
    write(shell.folder, {"src/a_msgs/msg/A.msg": "flaot32 x\n"})
    answer = shell("diff", "HEAD", "src")
    assert answer.code == 1 and "src/a_msgs/msg/A.msg:1:1: " in answer.err and answer.out == ""


@pytest.mark.parametrize(
    ("old", "error"),
    [
        ("nope", 'error: no revision "nope" in '),
        ("--output=x", 'error: "--output=x": expected a git revision'),
        ("-h:src", 'error: "-h:src": expected a git revision'),
        ("HEAD:../..", "is outside of "),
        ("HEAD:no/where", "error: HEAD:no/where: there is no such folder in this revision"),
        ("HEAD:docs", "error: HEAD:docs: there are no definitions in this folder"),
        ("HEAD..main", 'error: no revision "HEAD..main" in '),
        ("git:", "expected a source after git:"),
        ("x.mcap", "error: x.mcap: there is no such file or folder"),
        ("README", "error: README: a file that is not a bag"),
        ("a\nb", 'error: no revision "a�b" in '),
    ],
)
def test_invalid_sources_are_an_error(shell: Shell, old: str, error: str) -> None:
    repository(shell.folder, {"README": "", "docs/x": "", **{f"src/{name}": text for name, text in BEFORE.items()}})
    answer = shell("diff", "--", old, "src")
    assert answer.code == 1 and error in answer.err, answer.err
    assert sorted(path.name for path in shell.folder.iterdir()) == [".git", "README", "docs", "src"]


def test_revision_outside_git_repository_is_an_error(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(shell.folder.parent))
    write(shell.folder / "src", BEFORE)
    answer = shell("diff", "main", "src")
    assert (
        answer.code == 1 and 'error: "main" is neither a file nor a revision: src: not a git repository' in answer.err
    )


def test_malicious_git_trees_write_no_files_and_links_are_skipped(shell: Shell) -> None:
    """Git trees may contain any name; links and parent folders must not be followed."""
    folder = repository(shell.folder, {"src/a_msgs/msg/A.msg": "int8 a\n"})
    blob = git(folder, "rev-parse", "HEAD:src/a_msgs/msg/A.msg").strip()
    for name in ("..", ".", ""):
        record = f"100644 {name}/x.msg\0".encode() if not name else f"40000 {name}\0".encode()
        inner = tree(folder, b"100644 evil.msg\0" + bytes.fromhex(blob))
        outer = tree(folder, record + bytes.fromhex(inner))
        commit = git(folder, "commit-tree", outer, "-m", "x").strip()
        answer = shell("diff", f"{commit}:", "src")
        assert answer.code == 1 and answer.err.startswith("error: "), answer
    (folder / "src/a_msgs/msg/Link.msg").symlink_to("/etc/passwd")
    repository(folder, {}, "link")
    answer = shell("diff", "HEAD", "HEAD~1")
    assert answer.code == 0 and "note: HEAD:: links are skipped: src/a_msgs/msg/Link.msg" in answer.err
    assert not list(folder.rglob("evil.msg"))


def tree(folder: Path, content: bytes) -> str:
    done = subprocess.run(
        ["git", "hash-object", "-t", "tree", "-w", "--stdin", "--literally"],
        cwd=folder,
        input=content,
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.decode().strip()


def test_size_of_revision_is_limited(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    from rosidl_py_gen.generator_cli import git_revision

    repository(shell.folder, {f"src/{name}": text for name, text in BEFORE.items()})
    monkeypatch.setattr(git_revision, "MAX_BYTES", 10)
    answer = shell("diff", "HEAD", "src")
    assert answer.code == 1 and "expected at most 50000 with 10: name the folder of the packages" in answer.err


def test_diff_works_in_git_hooks_and_runs_no_repository_filters(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = repository(shell.folder, {"src/a_msgs/msg/A.msg": "int8 a\n", ".gitattributes": "*.msg filter=evil\n"})
    for name in ("smudge", "clean", "process"):
        git(folder, "config", f"filter.evil.{name}", f"touch {folder}/ran")
    monkeypatch.setenv("GIT_DIR", ".git")
    monkeypatch.setenv("GIT_INDEX_FILE", ".git/index")
    assert shell("diff", "HEAD", "src").code == 0
    assert not (folder / "ran").exists()


# --- bags -------------------------------------------------------------------------------------------------------------


def bag(path: Path, text: str = BEFORE[WHEEL], name: str = "my_msgs/msg/Wheel", **more: str) -> str:
    with BagWriter(path) as writer:
        writer.write("/wheel", compile_definition(name, text)(), log_time_ns=1)
        for topic, definition in more.items():
            writer.write(f"/{topic}", compile_definition(name, definition)(), log_time_ns=2)
    return str(path)


def test_bag_is_compared_with_definitions_of_a_folder(shell: Shell) -> None:
    write(shell.folder / "src", BEFORE)
    path = bag(shell.folder / "drive.mcap")
    answer = shell("diff", path, "src")
    assert (answer.code, answer.out) == (0, "0 changed, 0 added, 0 removed, 1 unchanged; not breaking\n")
    (shell.folder / "src" / WHEEL).write_text("float64 speed\nstring<=8 name\nint8 more\n")
    document = shell("diff", path, "src", "--json")
    assert document.code == 1 and [one["name"] for one in document.json["changed"]] == ["my_msgs/msg/Wheel"]
    assert document.json["changed"][0]["messages"][0]["fields"][0]["what"] == "default"
    (shell.folder / "src" / WHEEL).unlink()
    (shell.folder / "src/my_msgs/msg/Robot.msg").write_text("int8 a\n")
    (shell.folder / "src/my_msgs/srv/Turn.srv").write_text("---\n")
    (shell.folder / "src/my_msgs/action/Drive.action").unlink()
    answer = shell("diff", path, "src")
    assert (answer.code, answer.out.splitlines()[0]) == (1, "- my_msgs/msg/Wheel")


def test_types_of_bag_missing_in_folder_are_compared_with_bundled_ones(shell: Shell) -> None:
    write(shell.folder / "src", BEFORE)
    path = bag(shell.folder / "drive", "string data\nint8 more", "std_msgs/msg/String")
    document = shell("diff", path, "src", "--json").json
    assert [one["name"] for one in document["changed"]] == ["std_msgs/msg/String"]
    assert document["changed"][0]["messages"][0]["reads_old_data"] is False


def test_types_in_only_one_of_two_bags_are_not_compared(shell: Shell) -> None:
    one = bag(shell.folder / "one.mcap")
    other = bag(shell.folder / "other.mcap", "int8 a", "my_msgs/msg/Other")
    answer = shell("diff", one, other)
    assert answer.code == 0
    assert answer.out.startswith("not compared, as only one side has them: my_msgs/msg/Other, my_msgs/msg/Wheel\n")


def test_bag_with_two_definitions_of_a_type_is_refused(shell: Shell) -> None:
    write(shell.folder / "src", BEFORE)
    path = bag(shell.folder / "drive.mcap", old="float64 speed")
    answer = shell("diff", path, "src")
    assert answer.code == 1 and answer.out == ""
    assert "there are two definitions of my_msgs/msg/Wheel: RIHS01_" in answer.err
    assert "`rosidl-py bag convert --topics` makes a bag of one of them" in answer.err


def test_service_event_topics_are_compared_with_their_service(shell: Shell) -> None:
    write(shell.folder / "src", BEFORE)
    event: Any = get_service("my_msgs/srv/Turn", path="src").Event
    text = BEFORE["my_msgs/srv/Turn.srv"].replace("Wheel", "my_msgs/Wheel")
    wheel = f"{'=' * 80}\nMSG: my_msgs/Wheel\n{BEFORE[WHEEL]}"
    with BagWriter(shell.folder / "events.mcap") as writer:
        writer.add_topic("/events", BagTopic("/events", type_name(event), text + wheel, type_hash=type_hash(event)))
        writer.write("/events", event().encode(), log_time_ns=1)
    answer = shell("diff", "events.mcap", "src")
    assert answer.code == 0, answer.out
    assert answer.out.startswith("0 changed, 0 added, 0 removed, 2 unchanged")


def test_a_damaged_bag_is_an_error(shell: Shell) -> None:
    write(shell.folder / "src", BEFORE)
    (shell.folder / "x.mcap").write_bytes(b"no bag")
    answer = shell("diff", "x.mcap", "src")
    assert answer.code == 1 and answer.err.startswith("error: ") and "x.mcap" in answer.err
