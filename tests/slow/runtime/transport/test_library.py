"""Choice of libddsc: order of the candidates, and the error if there is none."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import pytest

from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsSupport
from rosidl_py_gen.runtime.transport.cyclone.library import REQUIRED_SYMBOLS, CycloneApi, DdscLibrary, candidates, load
from rosidl_py_gen.runtime.transport.cyclone.private_layout import VtableSlots

if TYPE_CHECKING:
    from collections.abc import Mapping

COMPILER = shutil.which("gcc") or shutil.which("cc")


def stub(folder: Path, names: tuple[str, ...], bodies: Mapping[str, str] = MappingProxyType({})) -> str:
    """Compile a library with these functions; `CALL(table, slot)` in `bodies` calls a function of a vtable of `p`."""
    source, made = folder / "stub.c", folder / "libddsc.so.9.8"
    lines = ["#define CALL(table, slot) ((int (*)(void)) ((void ***) p)[table][slot])()\n"]
    lines += [f"int {name}(void *p) {{ {bodies.get(name, '')} return 0; }}\n" for name in names]
    source.write_text("".join(lines), encoding="utf-8")
    subprocess.run([str(COMPILER), "-shared", "-fPIC", "-o", str(made), str(source)], check=True)
    return str(made)


def test_rosidl_libddsc_variable_is_the_only_candidate() -> None:
    assert list(candidates({"ROSIDL_LIBDDSC": "/somewhere/libddsc.so"})) == ["/somewhere/libddsc.so"]


def test_library_candidates_are_wheels_then_ros_then_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = "site/rosidl_libddsc/lib/libddsc.so.11", "site/rosidl_libddsc/__init__.py"
    for name in (*site, "ros/lib/libddsc.so", "ros/lib/x86_64-linux-gnu/libddsc.so"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.setitem(sys.modules, "cyclonedds", None)  # type: ignore[arg-type]
    found = list(candidates({"AMENT_PREFIX_PATH": str(tmp_path / "ros")}))
    assert found[:3] == [
        str(tmp_path / "site/rosidl_libddsc/lib/libddsc.so.11"),
        str(tmp_path / "ros/lib/libddsc.so"),
        str(tmp_path / "ros/lib/x86_64-linux-gnu/libddsc.so"),
    ]
    assert "libddsc.so.0debian" in found[3:]


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("libnowhere.so", "libnowhere.so: not found"),
        (__file__, "invalid ELF header"),
        ("libm.so.6", "libm.so.6: it is not a libddsc"),
    ],
)
def test_invalid_libddsc_error_names_the_file_and_reason(name: str, reason: str) -> None:
    found = load({"ROSIDL_LIBDDSC": name})
    assert isinstance(found, str) and reason in found and found.endswith("Correct ROSIDL_LIBDDSC, or unset it")


def test_missing_libddsc_error_contains_install_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "candidates", lambda environ: iter(["libnowhere.so"]))
    found = load({})
    assert isinstance(found, str) and found.endswith(f"To install it: {library.install_advice()}")


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_library_without_a_required_function_is_refused_by_name(tmp_path: Path) -> None:
    complete = load({"ROSIDL_LIBDDSC": stub(tmp_path, REQUIRED_SYMBOLS)})
    assert isinstance(complete, DdscLibrary) and complete.version == "9.8"
    assert complete.unsupported_elements >= {"IgnoreTypeInformation", "SPDPInterval"}
    (tmp_path / "old").mkdir()
    lacking = tuple(name for name in REQUIRED_SYMBOLS if name != "dds_qset_data_representation")
    found = load({"ROSIDL_LIBDDSC": stub(tmp_path / "old", lacking)})
    assert isinstance(found, str)
    assert "it lacks dds_qset_data_representation, which Cyclone DDS has from 0.10 on" in found


PROBED = {
    "ddsi_serdata_from_ser": "CALL(1, 3);",
    "ddsi_serdata_to_ser_ref": "CALL(0, 5);",
    "ddsi_sertype_derive_sertype": "CALL(0, 7);",
}


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize(
    ("wrong", "found"),
    [
        ({}, VtableSlots(3, 5, 7)),
        ({"ddsi_serdata_from_ser": "CALL(1, 3); CALL(1, 4);"}, None),
        ({"ddsi_serdata_from_ser": "CALL(0, 3);"}, None),
        ({"ddsi_serdata_to_ser_ref": "CALL(1, 5);"}, None),
        (dict.fromkeys(PROBED, ""), None),
    ],
)
def test_vtable_slots_are_used_only_if_unambiguous(
    tmp_path: Path, wrong: dict[str, str], found: VtableSlots | None
) -> None:
    loaded = load({"ROSIDL_LIBDDSC": stub(tmp_path, tuple({*REQUIRED_SYMBOLS, *PROBED}), {**PROBED, **wrong})})
    assert isinstance(loaded, DdscLibrary)
    assert FastDdsSupport(CycloneApi(loaded.handle)).slots == found


def test_loaded_library_reports_file_and_version() -> None:
    found = library.find_library()
    assert Path(found.file).is_file() and found.version[0].isdigit()
    assert found is library.find_library()
