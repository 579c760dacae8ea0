"""Names and remap rules: docs/internals/protocol.md 10.1 to 10.3."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen import runtime
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.runtime.names import (
    InvalidRemapRuleError,
    NodeNames,
    RemapKind,
    RemapRule,
    expand_name,
    normalize_namespace,
    parse_remap_rule,
    resolve_node_name,
    validate_full_name,
    validate_name,
    validate_node_name,
)


@pytest.mark.parametrize(
    "name", ["a", "/a/b", "a/b", "~", "~/a", "{node}/x", "a{ns}", "/a__b", "_hidden/x", "~/{node}"]
)
def test_valid_topic_names_are_accepted(name: str) -> None:
    validate_name(name)


NODE, NAMESPACE, FULL, NAME = (
    runtime.validate_node_name,
    runtime.validate_namespace,
    runtime.validate_full_name,
    runtime.validate_name,
)


@pytest.mark.parametrize(
    ("check", "name", "index", "reason"),
    [
        (NAME, "", 0, "it is empty"),
        (NAME, "a b", 1, "character ' ' is not allowed"),
        (NAME, "a/", 1, "must not end with '/'"),
        (NAME, "a/1b", 2, "must not begin with a digit"),
        (NAME, "1", 0, "must not begin with a digit"),
        (NAME, "~a", 1, "'~' must be followed by '/'"),
        (NAME, "a~", 1, "'~' may only be the first character"),
        (NAME, "a{b", 1, "'{' without '}'"),
        (NAME, "a}b", 1, "'}' without '{'"),
        (NAME, "{a{b}}", 2, "must not be nested"),
        (NAME, "x{1a}", 2, "'1a' is not a substitution name"),
        (NAME, "{}", 1, "'' is not a substitution name"),
        (NAME, "a-b", 1, "character '-' is not allowed"),
        (NAME, "äb", 0, "is not allowed"),
        (NAME, "a/1-", 3, "is not allowed"),  # a wrong character comes first, as in rcl
        (NAME, "1/", 0, "must not begin with a digit"),
        (FULL, "a", 0, "must begin with '/'"),
        (FULL, "/", 0, "must not end with '/'"),
        (FULL, "/a//b", 3, "must not contain '//'"),
        (FULL, "/a/2", 3, "begin with a digit"),
        (FULL, "/1//a", 1, "begin with a digit"),
        (FULL, "/~a", 1, "is not allowed"),
        (FULL, "/a~/", 3, "must not end with '/'"),
        (FULL, "/" + "a" * 247, 246, "248 characters"),
        (NODE, "", 0, "it is empty"),
        (NODE, "1a", 0, "must not begin with a digit"),
        (NODE, "a/b", 1, "is not allowed"),
        (NODE, "ä", 0, "is not allowed"),
        (NODE, "n" * 256, 254, "256 characters"),
        (NAMESPACE, "a", 0, "must begin with '/'"),
        (NAMESPACE, "/a//b", 3, "must not contain '//'"),
        (lambda name: expand_name(name, "n", "/"), "a/{b}", 2, r"unknown substitution {b}; expected one of {node}"),
    ],
)
def test_invalid_name_error_has_index_reason_and_caret(
    check: Callable[[str], None], name: str, index: int, reason: str
) -> None:
    with pytest.raises(InvalidNameError) as caught:
        check(name)
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        assert (error.name, error.index) == (name, index) and reason in error.reason
        assert f": {error.reason}\n" in str(error)
    assert str(caught.value).splitlines()[-1] == " " * (4 + min(index, 60)) + "^"


def test_name_that_is_not_a_string_is_refused_without_index() -> None:
    with pytest.raises(InvalidNameError, match="expected a str, got int 5") as caught:
        runtime.validate_namespace(5)  # type: ignore[arg-type]
    assert (caught.value.name, caught.value.index, caught.value.reason) == ("", None, "")


def test_invalid_expanded_name_is_reported_in_expanded_form() -> None:
    with pytest.raises(InvalidNameError) as caught:
        runtime.expand_name("/{ns}", "n", "/a")
    assert (caught.value.name, caught.value.index) == ("//a", 1)


def test_names_of_maximum_length_are_accepted_and_longer_ones_refused() -> None:
    validate_full_name("/" + "a" * 246)
    validate_node_name("n" * 255)
    assert normalize_namespace("a" * 244) == "/" + "a" * 244
    with pytest.raises(InvalidNameError, match="256 characters"):
        validate_node_name("n" * 256)
    with pytest.raises(InvalidNameError, match="246 characters"):
        normalize_namespace("a" * 245)


@pytest.mark.parametrize(("given_", "full"), [("", "/"), ("/", "/"), ("a", "/a"), ("/a/b", "/a/b")])
def test_namespace_is_normalized_with_leading_slash(given_: str, full: str) -> None:
    assert normalize_namespace(given_) == full


@pytest.mark.parametrize(
    ("name", "in_root", "in_ns"),
    [
        ("/x", "/x", "/x"),
        ("x", "/x", "/a/b/x"),
        ("~", "/n", "/a/b/n"),
        ("~/x", "/n/x", "/a/b/n/x"),
        ("{node}/x", "/n/x", "/a/b/n/x"),
        ("/{node}", "/n", "/n"),
        ("x_{node}_y", "/x_n_y", "/a/b/x_n_y"),
    ],
)
def test_topic_names_are_expanded_by_namespace_and_node_name(name: str, in_root: str, in_ns: str) -> None:
    assert expand_name(name, "n", "/") == in_root
    assert expand_name(name, "n", "/a/b") == in_ns


def test_namespace_substitution_includes_its_slash() -> None:
    assert expand_name("{ns}/x", "n", "/a") == "/a/x"
    assert expand_name("{namespace}/x", "n", "/a") == "/a/x"
    with pytest.raises(InvalidNameError, match="must not contain '//'"):
        expand_name("/{ns}", "n", "/a")


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("a:=b", RemapRule(RemapKind.TOPIC_AND_SERVICE, None, "a", "b")),
        ("/a/b:=~/c", RemapRule(RemapKind.TOPIC_AND_SERVICE, None, "/a/b", "~/c")),
        ("n:a:=b", RemapRule(RemapKind.TOPIC_AND_SERVICE, "n", "a", "b")),
        ("rostopic://a:=b", RemapRule(RemapKind.TOPIC, None, "a", "b")),
        ("n:rosservice://a:=b", RemapRule(RemapKind.SERVICE, "n", "a", "b")),
        ("__node:=m", RemapRule(RemapKind.NODE_NAME, None, "", "m")),
        ("n:__name:=m", RemapRule(RemapKind.NODE_NAME, "n", "", "m")),
        ("__ns:=/", RemapRule(RemapKind.NAMESPACE, None, "", "/")),
        ("n:__ns:=/a/b", RemapRule(RemapKind.NAMESPACE, "n", "", "/a/b")),
        ("~:=x", RemapRule(RemapKind.TOPIC_AND_SERVICE, None, "~", "x")),
    ],
)
def test_remap_rules_are_parsed(text: str, rule: RemapRule) -> None:
    assert parse_remap_rule(text) == rule


@pytest.mark.parametrize(
    "text",
    [
        "",
        ":=",
        "a",
        ":=b",
        "a:=",
        "a__b:=c",
        "a:=b__c",
        "__ns:=a",
        "__ns:=",
        "__node:=a/b",
        "__node:=",
        "a:=b/",
        "1a:=b",
        "a:b:c:=d",
        "a/*:=b",
        r"a:=\1",
        "{node}:=b",
        "a//b:=c",
        "n m:a:=b",
    ],
)
def test_invalid_remap_rule_error_quotes_the_rule(text: str) -> None:
    with pytest.raises(InvalidRemapRuleError) as caught:
        parse_remap_rule(text)
    assert repr(text) in str(caught.value)


def names(*rules: str, name: str = "n", namespace: str = "/") -> NodeNames:
    return NodeNames.create(name, namespace, tuple(parse_remap_rule(rule) for rule in rules))


def test_node_name_and_namespace_are_remapped_with_their_prefixes() -> None:
    made = names("other:__node:=no", "n:__node:=m", "n:__ns:=/no", "m:__ns:=/yes")
    assert (made.name, made.namespace, made.fully_qualified_name) == ("m", "/yes", "/yes/m")


def test_remap_rules_match_expanded_names_and_apply_once() -> None:
    made = names("chatter:=loud", "loud:=silent", namespace="/a")
    assert made.resolve_topic("chatter") == "/a/loud"
    assert made.resolve_topic("/a/chatter") == "/a/loud"
    assert made.resolve_topic("/chatter") == "/chatter"
    assert made.resolve_service("chatter") == "/a/loud"


def test_first_matching_remap_rule_applies_with_scheme_and_node_prefix() -> None:
    made = names("rosservice://x:=s", "rostopic://x:=t", "x:=both", "other:y:=no", "n:y:=yes")
    assert (made.resolve_topic("x"), made.resolve_service("x"), made.resolve_topic("y")) == ("/t", "/s", "/yes")


def test_private_names_use_the_remapped_node() -> None:
    made = names("__node:=m", "~/x:=~/y", namespace="/a")
    assert made.resolve_topic("~/x") == "/a/m/y"


@given(st.text(max_size=12))
def test_any_text_is_accepted_or_raises_invalid_name_error(text: str) -> None:
    for check in (
        validate_name,
        validate_full_name,
        validate_node_name,
        normalize_namespace,
        parse_remap_rule,
        lambda value: expand_name(value, "n", "/ns"),
    ):
        try:
            check(text)
        except InvalidNameError:
            continue


@given(st.text(alphabet="ab1_/~{}nodes:=", max_size=14))
def test_every_expanded_name_is_a_valid_full_name(text: str) -> None:
    try:
        full = expand_name(text, "node", "/ns")
    except InvalidNameError:
        return
    validate_full_name(full)
    assert expand_name(full, "other", "/elsewhere") == full


@pytest.mark.parametrize(
    ("given", "namespace", "full"),
    [("n", "/", "/n"), ("n", "/a", "/a/n"), ("/n", "/a", "/n"), ("/b/n", "/a", "/b/n"), ("b/n", "/a", "/b/n")],
)
def test_node_name_is_resolved_with_or_without_namespace(given: str, namespace: str, full: str) -> None:
    assert resolve_node_name(given, namespace) == full


@pytest.mark.parametrize("bad", ["", "/", "a b", "/a//n", "/1/n", "a/", None, 5])
def test_invalid_node_name_is_refused(bad: str) -> None:
    with pytest.raises(InvalidNameError, match=r"invalid (node name|namespace)"):
        resolve_node_name(bad, "/")
