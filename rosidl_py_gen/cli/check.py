"""Read definitions and report what is wrong with them."""

from __future__ import annotations

import json

import click

from rosidl_py_gen.generate import load
from rosidl_py_gen.spec.find import search_path


def run(names: tuple[str, ...], paths: tuple[str, ...], as_json: bool) -> int:
    """Returns the exit code; problems are raised and reported by the caller."""
    _, found = load(search_path(paths), list(names))
    packages = sorted({name.package for name in found})
    if as_json:
        click.echo(json.dumps({"interfaces": [str(name) for name in found], "errors": []}, indent=2))
    else:
        click.echo(f"{len(found)} interfaces in {len(packages)} packages: no problems")
    return 0
