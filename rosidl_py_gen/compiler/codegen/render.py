"""Rendering of the jinja2 templates.

A wheel has the templates as jinja2 compiled them (`hatch_build.py`) and their texts, in case the installed jinja2
cannot use the compiled ones; a checkout has the texts.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from rosidl_py_gen.base import resources
from rosidl_py_gen.compiler.codegen.python_literals import docstring, py_string

if TYPE_CHECKING:
    from jinja2 import Environment


def environment_of_texts() -> Environment:
    """Return a jinja2 environment with the texts of the templates and their filters."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

    environment = Environment(
        loader=FileSystemLoader(resources.templates_dir()),
        undefined=StrictUndefined,
        autoescape=select_autoescape(()),  # Python, not HTML; literals pass through `string` and `docstring`
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "docstring": lambda lines, indent: docstring(lines, " " * indent),
        "string": py_string,
        "code": _indented,
    }
    return environment


def _indented(text: str, indent: int = 0) -> str:
    return "\n".join(" " * indent + line if line.strip() else "" for line in text.splitlines())


@lru_cache(maxsize=1)
def _environment() -> Environment:
    from jinja2 import ChoiceLoader, ModuleLoader  # takes 30 ms to import

    environment = environment_of_texts()
    assert environment.loader is not None
    compiled = ModuleLoader(resources.compiled_templates_dir())
    environment.loader = ChoiceLoader([compiled, environment.loader])
    return environment


def preload() -> None:
    """Import jinja2 and load the template of modules, to save time when the first module is rendered."""
    _environment().get_template("module.py.jinja")


def render(template: str, **values: object) -> str:
    """Return the text of a template for some values."""
    return _environment().get_template(template).render(values)
