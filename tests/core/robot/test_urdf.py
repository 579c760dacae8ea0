"""URDF: joints, and errors that name the joint or link."""

from __future__ import annotations

import math
import os
import time
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.robot.urdf import Joint, Mimic, parse_urdf, read_description, resolve_mimics

LINKS = '<link name="base"/><link name="arm"/>'
ENDS = '<parent link="base"/><child link="arm"/>'
LIMIT = '<limit lower="-1" upper="2" effort="3" velocity="4"/>'


def robot(inside: str, links: str = LINKS) -> str:
    return f'<robot name="r">\n{links}\n{inside}\n</robot>'


def joint(inside: str = "", type: str = "continuous", ends: str = ENDS) -> str:
    return robot(f'<joint name="elbow" type="{type}">{ends}{inside}</joint>')


def only(text: str) -> Joint:
    (found,) = parse_urdf(text).values()
    return found


def test_all_values_of_a_joint_are_read() -> None:
    found = only(
        joint(
            '<origin xyz="1 -2.5 .5" rpy="0 0 1.5707963267948966"/><axis xyz="0 3 4"/>'
            '<limit lower="-1" upper="2e0" effort="3" velocity="4"/><mimic joint="other" multiplier="-2" offset="+1."/>'
            '<safety_controller k_velocity="1" soft_lower_limit="-0.5"/>',
            "revolute",
        )
    )
    assert (found.name, found.type, found.parent, found.child) == ("elbow", "revolute", "base", "arm")
    assert found.origin.translation == (1, -2.5, 0.5) and found.axis == (0, 0.6, 0.8)
    assert found.origin.rotation == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)))
    assert found.limits == (-1, 2) and found.soft_limits == (-0.5, math.inf)
    assert found.mimic == Mimic("other", -2, 1)


def test_values_that_a_joint_does_not_state_have_defaults() -> None:
    found = only(joint())
    assert (found.origin, found.axis) == (((0, 0, 0), (0, 0, 0, 1)), (1, 0, 0))
    assert (found.limits, found.soft_limits, found.mimic) == (None, (-math.inf, math.inf), None)
    assert only(joint('<origin rpy="0 0 0"/><mimic joint="a"/>')).mimic == Mimic("a", 1, 0)
    assert only(joint('<axis xyz="0 0 0"/>', "fixed")).type == "fixed"  # as exported by CAD programs


def test_other_elements_of_a_urdf_are_ignored() -> None:
    text = joint('<dynamics damping="1"/><calibration rising="0"/>').replace(
        "</robot>",
        '<gazebo reference="arm"><joint name="elbow"/></gazebo>'
        '<transmission name="t"><joint name="elbow"/></transmission>'
        "<ros2_control/><material name='m'/><sensor:camera name='undeclared prefix'/><!-- é --></robot>",
    )
    assert only(text).name == "elbow"
    assert parse_urdf('\n <?xml version="1.0" encoding="latin-1"?>\n' + text) == parse_urdf("\ufeff\n \n" + text)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (joint(type="hinge"), r"urdf>:3:1: joint \"elbow\": found type 'hinge'; expected fixed, revolute, "),
        (joint(type=""), 'joint "elbow": <joint> has no type; expected type="..."'),
        (robot("<joint type='fixed'/>"), 'joint: <joint> has no name; expected name="..."'),
        (joint(ends='<parent link="base"/>'), 'joint "elbow": no <child>; expected <child link="..."/>'),
        (joint(ends='<parent link="bse"/><child link="arm"/>'), 'link "bse" does not exist; did you mean "base"?'),
        (
            joint(ends='<parent link="tool"/><child link="arm"/>'),
            'joint "elbow": link "tool" does not exist; add <link name="tool"/> or remove the joint',
        ),
        (joint('<origin xyz="0 0"/>'), r"joint \"elbow\": <origin> has xyz='0 0'; expected three numbers"),
        (joint('<origin xyz="nan 0 0"/>'), "<origin> has xyz='nan 0 0'"),
        (joint('<origin xyz="0,5 0 0"/>'), "<origin> has xyz='0,5 0 0'"),
        (joint('<origin rpy="0 1_0 0"/>'), "<origin> has rpy='0 1_0 0'"),
        (joint(type="revolute"), 'joint "elbow": a revolute joint must have a <limit>; a continuous joint turns'),
        (joint(type="prismatic"), "a prismatic joint must have a <limit>"),
        (joint('<limit effort="1"/>'), '<limit> has no velocity; expected velocity="..."'),
        (joint('<limit lower="low" effort="1" velocity="1"/>'), "<limit> has lower='low'"),
        (joint('<mimic joint="a" offset="inf"/>'), "<mimic> has offset='inf'"),
        (robot("", LINKS + '\n<link name="arm"/>'), 'urdf>:3:1: second link "arm"; expected different names'),
        (robot(f'<joint name="a" type="fixed">{ENDS}</joint>\n' * 2), 'second joint "a"; expected different names'),
        (
            robot("".join(f'<joint name="{name}" type="fixed">{ENDS}</joint>' for name in "ab")),
            'link "arm" is the child of joint "a" and of joint "b"; expected one parent',
        ),
        (robot(""), 'no parents of links "base", "arm"; a joint must connect all but one'),
        (robot("", ""), "no links; expected at least one <link>"),
        (joint(ends='<parent link="arm"/><child link="arm"/>'), 'link "arm" is in a loop of joints; expected a tree'),
        (
            robot(
                '<joint name="a" type="fixed"><parent link="base"/><child link="arm"/></joint>'
                '<joint name="b" type="fixed"><parent link="arm"/><child link="base"/></joint>'
            ),
            "is in a loop of joints; expected a tree",
        ),
        ("", "found ''; expected the text of a URDF, not its path"),
        ("<sdf version='1.7'/>", "found <sdf>; expected a URDF of version 1.0, whose root is <robot>"),
        ("<robot name='a' version='2.0'/>", "found <robot>; expected a URDF of version 1.0"),
        ("<robot name='a'>", "urdf>:2:3: not XML: mismatched tag"),
        ("<robot name='a'>\n<link></robot>", "urdf>:2:9: not XML: mismatched tag"),
        ("<robot name='a' name='b'/>", "not XML: duplicate attribute"),
        ("<!DOCTYPE robot><robot/>", "urdf>:1:3: not XML: not well-formed"),
        ("<robot name='&a;'/>", "not XML: undefined entity"),
        ("<robot name='a'>\ud800</robot>", None),
        ("<robot name='\0'/>", "not XML"),
    ],
)
def test_errors_state_the_value_found_and_the_expected_value(text: str, error: str | None) -> None:
    with pytest.raises(DefinitionError) as caught:
        parse_urdf(text, "<urdf>")
    if error is not None:
        assert error.replace('\\"', '"') in str(caught.value)


def test_irregular_urdf_accepted_by_urdfdom_is_read_with_a_warning(caplog: Any) -> None:
    text = robot('<xacro:arg name="a"/>' + joint('<axis xyz="0 0 0"/>').split("\n")[2])
    found = only(f"<?xml version='1.0'?>\n<xacro:property name='a'/>\n{text}<robot name='second'/>")
    assert found.axis == (0, 0, 0) == only(joint('<axis xyz="1.7e308 1.7e308 0"/>')).axis
    assert "<robot_description>:5:1: <xacro:arg> ignored; expected the output of xacro, not its input" in caplog.text
    assert 'joint "elbow" is not published: its axis has length 0.0; expected one like 0 0 1' in caplog.text
    assert "is not published: its axis has length inf" in caplog.text


@pytest.mark.slow
def test_descriptions_are_limited_in_size_depth_and_number_of_elements() -> None:
    for text, error in (
        ("<robot>" + " " * (8 << 20), "more than 8388608 characters"),
        ("<a>" * 100, "nested more than 32 deep"),
        ("<robot>" + "<a/>x" * 1_500_000, "more than 100000 elements"),
        ("<robot>" + "<!---->" * 1_000_000, "more than 100000 elements"),
    ):
        started = time.process_time()
        tracemalloc.start()
        with pytest.raises(DefinitionError, match=error):
            parse_urdf(text)
        assert tracemalloc.get_traced_memory()[1] < 200e6
        tracemalloc.stop()
        assert time.process_time() - started < 5


@pytest.mark.slow
def test_very_long_and_very_wide_robots_are_read_in_bounded_time() -> None:
    links = "".join(f'<link name="l{n}"/>' for n in range(10_001))
    for parent in (lambda n: n, lambda n: 0):
        joints = "".join(
            f'<joint name="j{n}" type="continuous"><parent link="l{parent(n)}"/><child link="l{n + 1}"/>'
            f'<mimic joint="j{max(0, n - 1)}"/></joint>'
            for n in range(10_000)
        )
        started = time.process_time()
        found = parse_urdf(robot(joints, links))
        mimics = {name: one.mimic for name, one in found.items() if one.mimic is not None}
        order, problems = resolve_mimics(mimics, found)
        assert len(found) == 10_000 and not order and len(problems) == 1  # all follow j0, which follows itself
        del mimics["j0"]
        assert len(resolve_mimics(mimics, found)[0]) == 9_999
        assert time.process_time() - started < 10


@given(st.text(max_size=200) | st.text(alphabet="<>/=\"' robtlinkje&;!-[]?\n", max_size=200))
def test_any_text_is_read_or_refused_with_our_error(text: str) -> None:
    for one in (text, f"<robot name='a'>{text}</robot>", joint(text)):
        try:
            parse_urdf(one)
        except DefinitionError as error:
            assert str(error)


def test_urdf_files_are_read_or_refused_with_reason(tmp_path: Path) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text("\ufeff" + joint(), encoding="utf-8")
    assert only(read_description(str(file))).name == "elbow"
    file.write_bytes(joint("é").encode("latin-1"))
    os.mkfifo(tmp_path / "pipe")
    for path, error in (
        (file, "not UTF-8 at byte"),
        (tmp_path / "missing.urdf", "missing.urdf: cannot be read: No such file"),
        (tmp_path, "not a regular file|cannot be read"),
        (tmp_path / "pipe", "not a regular file"),
        ("a\0b", "not a path"),
    ):
        with pytest.raises(DefinitionError, match=error):
            read_description(str(path))


def test_mimics_follow_the_joint_they_depend_on() -> None:
    mimics = {"a": Mimic("b"), "b": Mimic("c"), "d": Mimic("c"), "x": Mimic("y"), "y": Mimic("z"), "z": Mimic("y")}
    found, problems = resolve_mimics(mimics | {"m": Mimic("elbo"), "n": Mimic("m")}, [*"abcdxyzmn", "elbow"])
    order = [*found]
    assert order.index("b") < order.index("a") and set(order) == {"a", "b", "d", "m", "n"}
    assert len(problems) == 2 and problems[0].startswith("joints mimic themselves: ")
    assert {*problems[0][25:].split(";")[0].split(" -> ")} == {"y", "z"}
    assert problems[1] == 'joint "m" mimics joint "elbo", not a moving joint; did you mean "elbow"?'
