"""The wheel holds every template compiled, and prints the same with these alone as a checkout does from the texts."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from jinja2 import ModuleLoader

TOP = Path(__file__).resolve().parents[1]


def run(top: Path, *words: str) -> None:
    """Run a module in a folder, whose packages it finds first."""
    done = subprocess.run([sys.executable, "-m", *words], cwd=top, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the package of a wheel lies."""
    folder = tmp_path_factory.mktemp("wheel")
    run(TOP, "hatchling", "build", "-t", "wheel", "-d", str(folder))
    (wheel,) = folder.glob("*.whl")
    with ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder / "rosidl_py_gen"


def test_a_wheel_holds_a_compiled_module_for_each_template_and_a_checkout_none(package: Path) -> None:
    templates = TOP / "templates"
    texts = [path.relative_to(templates).as_posix() for path in templates.rglob("*.jinja")]
    compiled = sorted(path.name for path in (package / "compiled_templates").iterdir() if path.is_file())
    assert compiled == sorted(map(ModuleLoader.get_module_filename, texts))
    assert len(compiled) > 5
    assert not (TOP / "rosidl_py_gen" / "compiled_templates").exists()


def test_compiled_templates_print_what_their_texts_print(package: Path, tmp_path: Path) -> None:
    for path in (package / "templates").rglob("*.jinja"):
        path.unlink()  # so that only the compiled ones are left
    printed = {}
    for name, top in (("wheel", package.parent), ("checkout", TOP)):
        out = tmp_path / name
        run(top, "rosidl_py_gen.cli", "--out", str(out))
        printed[name] = {path.relative_to(out): path.read_bytes() for path in out.rglob("*.py")}
    assert printed["wheel"] == printed["checkout"]
    assert len(printed["wheel"]) > 200
