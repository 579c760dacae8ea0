"""The YAML loader: values of scalars, errors, and parsing time proportional to the size of a text."""

from __future__ import annotations

import contextlib
import time

import pytest
import yaml

from rosidl_py_gen.bags.metadata import OfferedQoS
from rosidl_py_gen.base.yaml_text import MAX_VALUES, YamlError, YamlText
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.ros_cli.bag.yaml_files import parse
from rosidl_py_gen.ros_cli.values import parse_value
from rosidl_py_gen.runtime import ParameterFileError
from rosidl_py_gen.runtime.parameters.files import parse_parameter_file

PARTS = 300_000


def test_yaml_scalars_become_the_expected_python_values() -> None:
    expected = {
        "1:30": "1:30",
        "1:30.5": "1:30.5",
        "010": "010",
        "0x1F": 31,
        "0b11": 3,
        "1_000": "1_000",
        "-5": -5,
        "08": "08",
        "1e-3": 0.001,
        "1E5": 100_000.0,
        "2.5e-07": 2.5e-07,
        ".5": 0.5,
        "1.": 1.0,
        "-.inf": float("-inf"),
        "2001-01-01": "2001-01-01",
        "=": "=",
        "~": None,
        "yes": True,
        "'1'": "1",
        "9" * 401: "9" * 401,
        "{1: 2, yes: 3}": {"1": 2, "yes": 3},
        "a: &a {b: 1}\nc: {<<: *a, d: 2}": {"a": {"b": 1}, "c": {"b": 1, "d": 2}},
    }
    assert {text: YamlText(text).load() for text in expected} == expected


def test_scalars_loaded_for_rclpy_programs_match_pyyaml() -> None:
    texts = ["1:30", "1:30.5", "1e5", "1.5e+3", "010", "08", "0x1F", "0b11", "1_000", "-5", ".inf", "no", "~", "''"]
    assert [YamlText(text).load(like_rclpy=True) for text in texts] == [yaml.safe_load(text) for text in texts]


@pytest.mark.parametrize("like_rclpy", [False, True])
def test_refused_yaml_always_raises_yaml_error(like_rclpy: bool) -> None:
    expected = {
        "[1,": "2:1: did not find expected node content",
        "!!bool x": "a value does not match its tag: KeyError",
        "!!timestamp x": "a value does not match its tag",
        "!!int ''": "a value does not match its tag",
        f"!!int {'1' * 401}": "1:1: expected a number, got '111",
        "&a [*a]": f"more than {MAX_VALUES} values",
        "[" * 101 + "]" * 101: "1:101: more than 100 levels",
        "%TAG !a b\n" * 21 + "--- x": "more than 20 %TAG directives",
        "'\ud800'": "expected UTF-8",
        "\1": "control characters",
        "[a]: b": "1:1: found unhashable key",
        "x" * 2001: "2001 bytes; expected at most 2000",
    }
    for text, reason in expected.items():
        with pytest.raises(YamlError) as caught:
            YamlText(text, max_bytes=2000).load(like_rclpy=like_rclpy)
        assert reason in str(caught.value)


@pytest.mark.slow
def test_parsing_time_is_proportional_to_the_text_size() -> None:
    ints = ",".join(f"{index * (2**61 - 1)}: 1" for index in range(20_000))  # all have one hash
    hostile = {
        "sexagesimal": "1:" * PARTS + "1",
        "tagged": "!!int " + "1:" * PARTS + "1",
        "real": "!!float " + "1:" * PARTS + "1.5",
        "digits": "0x" + "f" * PARTS,
        "keys": f"{{{ints}}}",
        "directives": "".join(f"%TAG !a{index}! b\n" for index in range(40_000)) + "--- a\n",
        "merges": "{" + "<<: {}, " * 40_000 + "}",
    }
    began = time.process_time()
    for text in hostile.values():
        yaml_text = YamlText(text)
        for read in (yaml_text.load, lambda one=yaml_text: one.load(like_rclpy=True), yaml_text.compose):
            with contextlib.suppress(YamlError):
                read()
    for reader in (parse_value, parse_parameter_file, lambda text: parse(text, "name")):
        with contextlib.suppress(CommandError, ParameterFileError):
            reader(hostile["sexagesimal"])
    assert OfferedQoS.parse("- " + hostile["sexagesimal"]) == []
    assert time.process_time() - began < 15  # quadratic: a minute for most of these alone
