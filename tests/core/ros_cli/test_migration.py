"""Refused plans of conversions; `tests/core/ros_cli/test_bag_migrate.py` tests accepted plans."""

from __future__ import annotations

from typing import Any

import pytest

from rosidl_py_gen.base.fieldtype import parse_field_type
from rosidl_py_gen.ros_cli.bag.migration import MigrationError, MigrationRules, RenameRule, plan

A = "a_msgs/msg/A"


def types(**messages: str) -> Any:
    """Return the fields of messages, as ``A="int8 x, string y"`` for a_msgs/msg/A."""
    fields = {name: [part.split() for part in text.split(",")] for name, text in messages.items()}
    return {
        f"a_msgs/msg/{name}": [(field, parse_field_type(kind)) for kind, field in of] for name, of in fields.items()
    }


def rules(renamed: dict[str, str]) -> MigrationRules:
    return MigrationRules({}, {A: {old: RenameRule(new, "r:2:3") for old, new in renamed.items()}})


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("float32", "int32"),
        ("int8", "bool"),
        ("string", "int8"),
        ("int8", "string"),
        ("int8", "int8[]"),
        ("int8[2]", "int8"),
        ("int8", "a_msgs/msg/B"),
    ],
)
def test_conversion_that_would_change_values_is_refused_and_a_rule_drops_the_field(old: str, new: str) -> None:
    one, other = types(A=f"{old} x"), types(A=f"{new} x", B="int8 b")
    with pytest.raises(MigrationError, match=r"a_msgs/msg/A.x: .* cannot become .*; a rule `fields: ") as caught:
        plan(one, other, A, MigrationRules())
    assert str(caught.value).endswith("{a_msgs/msg/A: {x: null}}` drops it")
    assert plan(one, other, A, rules({"x": ""}))[A, A].defaulted == ("x",)


def test_all_rules_with_unknown_or_repeated_fields_are_reported_with_location() -> None:
    with pytest.raises(MigrationError) as caught:
        renames = rules({"sped": "x", "y": "w", "z": "x"})
        plan(types(A="int8 speed, int8 y, int8 z"), types(A="int8 x"), A, renames)
    assert str(caught.value).splitlines() == [
        'r:2:3: a_msgs/msg/A has no field sped; did you mean "speed"?',
        "r:2:3: a_msgs/msg/A has no field w",
        "r:2:3: x is the target of sped already",
    ]
