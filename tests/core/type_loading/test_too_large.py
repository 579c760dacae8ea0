"""Definitions above the limit of elements: every way to a class raises the same error, and other types are used."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from support.bag_samples import write_foreign
from support.inner_state import type_fields
from support.rclpy_messages import hooked

from rosidl_py_gen import DefinitionError, compile_definition, get_message
from rosidl_py_gen.bags import BagReader, BagWarning, DecoderFactory
from rosidl_py_gen.base.descriptions import TypeDescriptions
from rosidl_py_gen.base.fieldtype import FieldType
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.compiler.frontend.size_limits import MAX_ELEMENTS
from rosidl_py_gen.compiler.generate import generate
from rosidl_py_gen.type_loading.from_description import DescribedType

WIDE = "".join(f"float32 f{i}\n" for i in range(MAX_ELEMENTS + 1))
AT_LIMIT = "".join(f"float32 f{i}\n" for i in range(MAX_ELEMENTS))
SMALL = "float32 x\n"
REASON = (
    rf":{MAX_ELEMENTS + 1}:9: wide_msgs/msg/Wide has {MAX_ELEMENTS + 1} fields .*, at most {MAX_ELEMENTS} are allowed"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a package of a message that is too large, one that contains it, and one that is not."""
    package = tmp_path / "src" / "wide_msgs"
    (package / "msg").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>wide_msgs</name></package>")
    for name, text in {"Wide": WIDE, "Outer": "Wide[] all\n", "Small": SMALL}.items():
        (package / "msg" / f"{name}.msg").write_text(text)
    return package.parent


@pytest.mark.parametrize("name", ["Wide", "Outer"])
def test_classes_of_files_are_refused(folder: Path, name: str) -> None:
    with pytest.raises(DefinitionError, match=rf"Wide\.msg{REASON}"):
        get_message(f"wide_msgs/msg/{name}", path=folder)
    assert get_message("wide_msgs/msg/Small", path=folder)(x=1.0).x == 1.0


@pytest.mark.parametrize("api", ["native", "rclpy"])
def test_imports_are_refused(folder: Path, api: Any) -> None:
    with hooked(message_api=api, path=str(folder)):
        for name in ("Wide", "Outer"):
            with pytest.raises(DefinitionError, match=rf"Wide\.msg{REASON}"):
                getattr(importlib.import_module("wide_msgs.msg"), name)
        assert importlib.import_module("wide_msgs.msg").Small(x=1.0).x == 1.0


def test_generation_is_refused_or_goes_on_with_the_other_messages(folder: Path, tmp_path: Path) -> None:
    search, out = SearchPath.scan([folder], ament=""), tmp_path / "out"
    with pytest.raises(DefinitionError, match=rf"Wide\.msg{REASON}"):
        generate(search, ["wide_msgs"], out)
    assert not out.exists()
    result = generate(search, ["wide_msgs"], out, keep_going=True)
    assert [name.name for name in result.names if name.package == "wide_msgs"] == ["Small"]
    assert any("has 2001 fields" in problem.text for problem in result.problems)


def test_texts_of_bags_are_refused() -> None:
    with pytest.raises(DefinitionError, match=f"<wide_msgs/msg/Wide>{REASON}"):
        compile_definition("wide_msgs/msg/Wide", WIDE)
    schema: Any = SimpleNamespace(name="wide_msgs/msg/Wide", data=WIDE.encode(), encoding="ros2msg")
    with pytest.raises(DefinitionError, match=REASON):
        DecoderFactory().decoder_for("cdr", schema)
    assert len(type_fields(compile_definition("wide_msgs/msg/AtLimit", AT_LIMIT))) == MAX_ELEMENTS


def test_descriptions_of_nodes_are_refused() -> None:
    """A description has at most 1000 fields of one type; nested messages make more of them."""
    small = compile_definition("wide_msgs/msg/Pair", "float32 x\nfloat32 y\n")
    rows = [(f"f{i}", FieldType.parse("wide_msgs/msg/Pair"), "") for i in range(700)]
    pair = [(field.ros_name, field.type, "") for field in type_fields(small)]
    described = {
        name: TypeDescriptions.of_fields(name, found)
        for name, found in {"wide_msgs/msg/Many": rows, "wide_msgs/msg/Pair": pair}.items()
    }
    with pytest.raises(DefinitionError, match=r"wide_msgs/msg/Many has 2001 fields .* at most 2000 are allowed"):
        DescribedType("wide_msgs/msg/Many", described).load()


def test_other_topics_of_a_bag_are_read(tmp_path: Path) -> None:
    sample = compile_definition("wide_msgs/msg/Small", SMALL)(x=2.5).encode()
    path = write_foreign(
        tmp_path / "bag.mcap",
        ("/wide", "wide_msgs/msg/Wide", WIDE, [(1, b"\0\1\0\0" + bytes(4 * len(WIDE.splitlines())))]),
        ("/small", "wide_msgs/msg/Small", SMALL, [(2, sample)]),
    )
    with BagReader(path) as bag:
        with pytest.warns(BagWarning, match="skipped /wide: .*has 2001 fields"):
            assert [(item.topic, item.message.x) for item in bag.messages()] == [("/small", 2.5)]
        assert bag.skipped["/wide"].count == 1
        with pytest.raises(DefinitionError, match=REASON):
            list(bag.messages("/wide"))
        assert len(list(bag.messages("/wide", raw=True))) == 1


@pytest.mark.needs("pyarrow")
def test_other_topics_of_a_bag_become_tables(tmp_path: Path) -> None:
    from rosidl_py_gen.tables import write_dataset

    sample = compile_definition("wide_msgs/msg/Small", SMALL)(x=2.5).encode()
    path = write_foreign(
        tmp_path / "bag.mcap",
        ("/wide", "wide_msgs/msg/Wide", WIDE, [(1, bytes(8))]),
        ("/small", "wide_msgs/msg/Small", SMALL, [(2, sample)]),
    )
    with BagReader(path) as bag:
        report = write_dataset(bag, tmp_path / "tables")
    assert "has 2001 fields" in report.skipped_topics["/wide"] and [*report.skipped_topics] == ["/wide"]
    with BagReader(path) as bag:
        assert bag.table("/small")["x"].to_pylist() == [2.5]
        with pytest.raises(DefinitionError, match=REASON):
            bag.table("/wide")
