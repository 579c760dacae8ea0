"""``print_results.py program.py``: print the results of a program's expressions as JSON, under either rclpy."""

from __future__ import annotations

import ast
import json
import re
import sys
import warnings
from pathlib import Path
from typing import Any


def text_of(value: object) -> str:
    """Return the `repr`, with the values of parameters and without addresses."""
    if type(value).__module__ == "rclpy.parameter" and type(value).__name__ == "Parameter":
        held: Any = value
        plain = isinstance(held.value, (str, int, float, bool, type(None)))
        return f"Parameter({held.name!r}, {held.type_.name}, {held.value if plain else list(held.value)!r})"
    if isinstance(value, (list, tuple)):
        return f"{type(value).__name__}({', '.join(map(text_of, value))})"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key!r}: {text_of(item)}' for key, item in value.items())}}}"
    return re.sub(r" at 0x[0-9a-f]+", "", repr(value))


def results_of(source: str, name: str) -> dict[int, tuple[str, str]]:
    space: dict[str, object] = {}
    found = {}
    for node in ast.parse(source).body:
        try:
            if isinstance(node, ast.Expr):
                value = eval(compile(ast.Expression(node.value), name, "eval"), space)
                found[node.lineno] = ("value", text_of(value))
            else:
                exec(compile(ast.Module([node], []), name, "exec"), space)
        except Exception as error:
            kinds = [
                kind.__name__ for kind in type(error).__mro__ if kind.__module__.split(".")[0] in ("builtins", "rclpy")
            ]
            found[node.lineno] = (" ".join(kinds), re.sub(r", at /\S+| at 0x[0-9a-f]+", "", str(error)))
    return found


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    path = Path(sys.argv[1])
    result = results_of(path.read_text(encoding="utf-8"), path.name)
    print("\n" + json.dumps(result))
