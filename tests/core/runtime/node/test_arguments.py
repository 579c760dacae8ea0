"""``--ros-args``: docs/internals/protocol.md 10.4."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.names import RemapKind
from rosidl_py_gen.runtime.node.settings import RosArgumentError, RosArguments, parse_arguments
from rosidl_py_gen.runtime.parameters.values import parameter_value

FILES = {
    "a.yaml": "/n: {ros__parameters: {y: from file}}\n/**: {ros__parameters: {x: 1}}",
    "b.yaml": "n: {ros__parameters: {x: 2}}",
    "bad.yaml": "a: {",
    "utf8.yaml": "/**: {ros__parameters: {x: Ã¼}}",
    "latin1.yaml": "/**: {ros__parameters: {x: ü}}",
}


@pytest.fixture(autouse=True, scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Make a folder with the files the current one."""
    folder = tmp_path_factory.mktemp("args")
    for name, text in FILES.items():
        (folder / name).write_bytes(text.encode("latin-1"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield


def parse(text: str) -> RosArguments:
    return parse_arguments(text.split())


def test_arguments_outside_of_ros_args_are_left_to_the_program() -> None:
    assert parse("prog --verbose -r x --") == RosArguments(program=["prog", "--verbose", "-r", "x", "--"])
    assert parse_arguments([]) == RosArguments()


def test_ros_args_groups_end_at_double_dash_and_may_be_repeated() -> None:
    got = parse("prog one --ros-args -r a:=b -- two --ros-args -r c:=d --ros-args -e /x")
    assert got.program == ["prog", "one", "two"]
    assert [rule.match for rule in got.remap_rules] == ["a", "c"] and got.enclave == "/x"


def test_every_ros_argument_flag_is_parsed() -> None:
    got = parse(
        "prog --ros-args -r a:=b --remap n:c:=d -p x:=1 --param n:y:=2 --params-file a.yaml --log-level DEBUG "
        "--log-level my.node:=warn -e /e --log-file-name pre "
        "--disable-stdout-logs --disable-rosout-logs --disable-external-lib-logs --enable-rosout-logs"
    )
    assert [(rule.node, rule.match) for rule in got.remap_rules] == [(None, "a"), ("n", "c")]
    assert (got.logs.level, got.logs.levels) == (10, (("my.node", 30),))
    assert (got.enclave, got.logs.file_name) == ("/e", "pre")
    assert (got.logs.stdout, got.logs.rosout, got.logs.external_lib) == (False, True, False)
    assert got.overrides_for("/n") == {
        "x": parameter_value(1),
        "y": parameter_value("from file"),
    }


def test_later_parameter_arguments_override_earlier_ones() -> None:
    assert parse("p --ros-args --params-file a.yaml -p x:=5").overrides_for("/n")["x"].value == 5
    assert parse("p --ros-args -p x:=5 --params-file a.yaml").overrides_for("/n")["x"].value == 1
    assert parse("p --ros-args --params-file utf8.yaml").overrides_for("/n")["x"].value == "ü"
    both = parse("p --ros-args --params-file a.yaml --params-file b.yaml")
    assert both.overrides_for("/n")["x"].value == 2 and both.overrides_for("/m")["x"].value == 1


def test_parameter_values_are_parsed_as_yaml() -> None:
    got = parse_arguments(["p", "--ros-args", "-p", "a.b:=[1, 2]", "-p", "s:='5'", "-p", "u:=http://x:=y"])
    assert {name: value.value for name, value in got.overrides_for("/n").items()} == {
        "a.b": (1, 2),
        "s": "5",
        "u": "http://x:=y",
    }


def test_parameter_with_node_prefix_applies_to_that_node_only() -> None:
    got = parse("p --ros-args -p n:x:=1 -p /ns/n:x:=2")
    assert got.overrides_for("/n")["x"].value == 1
    assert got.overrides_for("/ns/n")["x"].value == 2
    assert got.overrides_for("/m") == {}


def test_remap_rule_outside_of_ros_args_is_applied_with_warning() -> None:
    got = parse("prog a:=b __ns:=/x key=value")
    assert got.program == ["prog", "key=value"]
    assert [rule.kind for rule in got.remap_rules] == [RemapKind.TOPIC_AND_SERVICE, RemapKind.NAMESPACE]
    assert len(got.warnings) == 2 and "--ros-args -r a:=b" in got.warnings[0]


def test_invalid_remap_rule_outside_of_ros_args_stays_a_program_argument() -> None:
    assert parse("prog a*:=b").program == ["prog", "a*:=b"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ("--nope", "unknown ROS arguments: '--nope'"),
        ("stray -r a:=b --more", "unknown ROS arguments: 'stray' '--more'"),
        ("-r", "ROS argument -r needs a value"),
        ("-r ab", "ROS argument -r 'ab': invalid remap rule 'ab'"),
        ("-r --", "ROS argument -r '--': invalid remap rule"),
        ("-p x", "ROS argument -p 'x': there is no ':='"),
        ("-p :=1", "'' is not a parameter name"),
        ("-p n:m:x:=1", "'m:x' is not a parameter name"),
        ("-p x:=", "ROS argument -p 'x:=': <value>: empty value"),
        ("-p x:={a:1}", "found a map"),
        ("--log-level loud", "unknown log level 'loud'"),
        ("--log-level :=info", "the logger's name is missing"),
        ("-e x", "must begin with '/'"),
        ("-e /1", "must not begin with a digit"),
        ("--params-file none.yaml", "the file cannot be read"),
        ("--params-file latin1.yaml", "the file cannot be read"),
        ("--params-file bad.yaml", "bad.yaml:2:1"),
        (
            "--log-file-name a/b",
            "ROS argument --log-file-name 'a/b': expected the prefix of a file name, without folder",
        ),
        ("--log-file-name ..\\b", "without folder"),
        ("--log-config-file c.conf", "argument --log-config-file 'c.conf': log configuration files are not supported"),
        ("--log-config-file c.conf", "use --log-level [logger:=]LEVEL, or configure Python's logging in the program"),
        ("--enable-nothing", "unknown ROS arguments: '--enable-nothing'"),
    ],
)
def test_ros_argument_errors_name_the_argument_and_reason(arguments: str, reason: str) -> None:
    with pytest.raises(RosArgumentError) as caught:
        parse("prog --ros-args " + arguments)
    assert reason in str(caught.value)


WORD = st.one_of(
    st.text(max_size=8),
    st.sampled_from(
        [
            "--ros-args",
            "--",
            "-r",
            "-p",
            "-e",
            "--params-file",
            "--log-level",
            "a.yaml",
            "bad.yaml",
            "a:=b",
            "x:=[1",
            "n:x:=1",
            "__ns:=/",
            "x:=&a",
            "debug",
            ":=",
            "--disable-rosout-logs",
            "a:=*",
        ]
    ),
)


@given(st.lists(WORD, max_size=10), st.booleans())
def test_random_arguments_raise_at_most_ros_argument_error(arguments: list[str], is_group: bool) -> None:
    try:
        got = parse_arguments(["--ros-args"] * is_group + arguments)
    except RosArgumentError:
        return
    assert all(argument in arguments for argument in got.program)
