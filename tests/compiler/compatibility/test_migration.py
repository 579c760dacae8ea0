"""Plans of conversions: targets of values, and refused conversions."""

from __future__ import annotations

import pytest

from rosidl_py_gen.base.fieldtype import parse_field_type
from rosidl_py_gen.compiler.compatibility.migration import (
    ConversionKind,
    MessagePlan,
    MigrationError,
    MigrationRules,
    RenameRule,
    plan,
)

A, B = "a_msgs/msg/A", "a_msgs/msg/B"


def types(**messages: str) -> dict[str, list[tuple[str, object]]]:
    """``A="int8 x, string y"`` -> the fields of a_msgs/msg/A."""
    made = {}
    for name, text in messages.items():
        pairs = [part.split() for part in text.split(",") if part.strip()]
        made[f"a_msgs/msg/{name}"] = [(field, parse_field_type(kind)) for kind, field in pairs]
    return made


def rules(types: dict[str, str] | None = None, **fields: dict[str, str]) -> MigrationRules:
    return MigrationRules(
        {old: RenameRule(new, "r:1:1") for old, new in (types or {}).items()},
        {
            f"a_msgs/msg/{owner}": {old: RenameRule(new, "r:2:3") for old, new in renamed.items()}
            for owner, renamed in fields.items()
        },
    )


def planned(old: str, new: str, told: MigrationRules | None = None) -> MessagePlan:
    return plan(types(A=old), types(A=new), A, told or MigrationRules())[A, A]  # type: ignore[arg-type]


def test_values_go_by_name_and_the_rest_is_listed() -> None:
    found = planned("int8 x, string y, bool z", "string y, int8 x, float32 new")
    assert [(step.old, step.new, step.kind) for step in found.steps] == [
        ("x", "x", ConversionKind.COPY),
        ("y", "y", ConversionKind.COPY),
    ]
    assert (found.dropped, found.dropped_by_rule, found.defaulted, found.is_conversion) == (("z",), (), ("new",), True)
    assert not planned("int8 x", "int8 x").is_conversion


def test_a_rule_renames_a_field_or_lets_it_go() -> None:
    found = planned("int8 x, int8 y, int8 z", "int8 y, int8 z", rules(A={"x": "y", "z": ""}))
    assert [(step.old, step.new) for step in found.steps] == [("x", "y")]
    assert (found.dropped, found.dropped_by_rule, found.defaulted) == (("y", "z"), ("z",), ("z",))


@pytest.mark.parametrize(
    ("old", "new", "way"),
    [
        ("int8", "int64", "number"),
        ("int64", "int8", "number"),
        ("bool", "float32", "number"),
        ("float64", "float32", "number"),
        ("byte", "uint8", "copy"),
        ("string", "wstring", "copy"),
        ("string<=8", "string", "copy"),
        ("int8[3]", "int8[]", "copy"),
        ("int8[<=3]", "uint16[4]", "number"),
        ("float32", "int32", None),
        ("int8", "bool", None),
        ("string", "int8", None),
        ("int8", "string", None),
        ("int8", "int8[]", None),
        ("int8[2]", "int8", None),
        ("int8", "a_msgs/msg/B", None),
    ],
)
def test_a_value_is_carried_over_where_none_becomes_another_in_silence(old: str, new: str, way: str | None) -> None:
    one, other = types(A=f"{old} x"), types(A=f"{new} x", B="int8 b")
    if way is not None:
        assert plan(one, other, A, MigrationRules())[A, A].steps[0].kind.value == way  # type: ignore[arg-type]
        return
    with pytest.raises(MigrationError, match=r"a_msgs/msg/A.x: .* cannot become .*; a rule `fields: ") as caught:
        plan(one, other, A, MigrationRules())  # type: ignore[arg-type]
    assert str(caught.value).endswith("{a_msgs/msg/A: {x: null}}` drops it")
    assert plan(one, other, A, rules(A={"x": ""}))[A, A].defaulted == ("x",)  # type: ignore[arg-type]


def test_nested_types_follow_and_one_that_is_called_otherwise_needs_a_rule() -> None:
    old, new = types(A=f"{B}[] many", B="int8 x, int8 y"), types(A="a_msgs/msg/C[] many", C="int8 x")
    with pytest.raises(MigrationError, match=r"unless a rule `types: \{a_msgs/msg/B: a_msgs/msg/C\}` maps one to"):
        plan(old, new, A, MigrationRules())  # type: ignore[arg-type]
    found = plan(old, new, A, rules({B: "a_msgs/msg/C"}))  # type: ignore[arg-type]
    assert found[A, A].steps[0].kind is ConversionKind.MESSAGE and found[B, "a_msgs/msg/C"].dropped == ("y",)


def test_rules_that_name_what_is_not_there_are_all_told_with_their_place() -> None:
    with pytest.raises(MigrationError) as caught:
        planned("int8 speed, int8 y, int8 z", "int8 x", rules(A={"sped": "x", "y": "w", "z": "x"}))
    assert str(caught.value).splitlines() == [
        'r:2:3: a_msgs/msg/A has no field sped; did you mean "speed"?',
        "r:2:3: a_msgs/msg/A has no field w",
        "r:2:3: x is the target of sped already",
    ]
