"""Every error class of the package derives from RosidlError and is named accordingly."""

from __future__ import annotations

import ast
import builtins

from support.folders import ROOT

PACKAGE = ROOT / "rosidl_py_gen"
BUILTIN = {name for name, kind in vars(builtins).items() if isinstance(kind, type) and issubclass(kind, BaseException)}
WARNINGS = {name for name in BUILTIN if name.endswith("Warning")}
"""Warnings, which do not derive from our errors."""
# What readers of definitions raise and the compiler makes a `Problem` of, with its place; users never see them.
BECOME_PROBLEMS = {"LiteralProblem", "SyntaxProblem", "UnreadableError"}


def error_classes() -> dict[str, set[str]]:
    """Return the package's classes that can be raised, each with the names of all its base classes."""
    bases = {
        node.name: {ast.unparse(base).rpartition(".")[2] for base in node.bases}
        for path in PACKAGE.rglob("*.py")
        if not path.is_relative_to(PACKAGE / "ros_compat")  # names and bases there are rclpy's
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    }

    def above(name: str) -> set[str]:
        direct = bases.get(name, set()) - {name}
        return direct.union(*map(above, direct))

    raised = {name: found for name in bases if (found := above(name)) & BUILTIN}
    return {name: found for name, found in raised.items() if not (found & WARNINGS and name.endswith("Warning"))}


def test_every_error_class_ends_in_error_and_derives_from_rosidl_error() -> None:
    found = error_classes()
    assert len(found) > 60 and set(found) >= BECOME_PROBLEMS
    shared = {name for name in found if not name.startswith("_")} - BECOME_PROBLEMS - {"RosidlError"}
    assert {name for name in shared if not name.endswith("Error")} == set()
    assert {name for name in shared if "RosidlError" not in found[name]} == set()
