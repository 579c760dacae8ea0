"""Installation of libddsc from the wheel of another Python: the chosen file, its checks, and the errors."""

from __future__ import annotations

import hashlib
import subprocess
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import pytest

from rosidl_py_gen.errors import OutputError
from rosidl_py_gen.generator_cli import main
from rosidl_py_gen.runtime.transport.cyclone import library
from rosidl_py_gen.runtime.transport.cyclone.library import LibraryWheel
from rosidl_py_gen.wheels import libddsc
from rosidl_py_gen.wheels.environment import Installer

PLATFORMS = {
    ("linux", "x86_64"): "cyclonedds-11.0.1-cp313-cp313-manylinux_2_17_x86_64.manylinux2014_x86_64.whl",
    ("darwin", "arm64"): "cyclonedds-11.0.1-cp313-cp313-macosx_11_0_arm64.whl",
    ("darwin", "x86_64"): "cyclonedds-11.0.1-cp313-cp313-macosx_10_13_x86_64.whl",
    ("win32", "AMD64"): "cyclonedds-11.0.1-cp313-cp313-win_amd64.whl",
}


def on_platform(
    monkeypatch: pytest.MonkeyPatch, system: str, machine: str, *, glibc: str | None = "glibc 2.36"
) -> LibraryWheel | None:
    """Return the wheel of a platform that is not the one of this machine."""
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.setattr("os.confstr", lambda name: glibc, raising=False)
    return library.library_wheel()


def this_wheel() -> LibraryWheel:
    wheel = library.library_wheel()
    if wheel is None:
        pytest.skip("cyclonedds has no wheel for this platform")
    return wheel


@pytest.mark.parametrize(("platform", "file"), PLATFORMS.items())
def test_wheel_of_the_platform_is_chosen(platform: tuple[str, str], file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    wheel = on_platform(monkeypatch, *platform)
    assert wheel is not None and wheel.file == file
    monkeypatch.setattr(library, "has_gil_build", lambda: True)
    monkeypatch.setattr("sys.version_info", (3, 14, 0, "final", 0))
    assert not library.has_wheel() and library.install_advice() == "rosidl-py-gen libddsc"
    monkeypatch.setattr("sys.version_info", (3, 13, 0, "final", 0))
    assert library.has_wheel() and library.install_advice().startswith("pip install ")


@pytest.mark.parametrize(
    ("system", "machine", "glibc", "advice"),
    [
        ("linux", "aarch64", "glibc 2.36", "apt install libddsc0debian"),
        ("linux", "x86_64", None, "does not use glibc"),
        ("win32", "ARM64", None, "build Cyclone DDS"),
        ("freebsd14", "amd64", None, "build Cyclone DDS"),
    ],
)
def test_platform_without_wheel_is_one_line_error_with_other_advice(
    system: str, machine: str, glibc: str | None, advice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert on_platform(monkeypatch, system, machine, glibc=glibc) is None
    with monkeypatch.context() as patched:
        patched.setattr(libddsc.InstalledLibrary, "install", partial(pytest.fail, "it is installed"))
        assert libddsc.InstalledLibrary.install_missing() is None
    with pytest.raises(OutputError, match=r"^libddsc: no wheel of cyclonedds is recorded for this platform; ") as error:
        libddsc.InstalledLibrary.install()
    assert advice in str(error.value) and "\n" not in str(error.value)


def fake_wheel(folder: Path, wheel: LibraryWheel) -> Path:
    """Write a wheel with the name of the recorded one and other contents."""
    info = f"cyclonedds-{wheel.VERSION}.dist-info"
    file = folder / wheel.file
    with ZipFile(file, "w") as archive:
        archive.writestr(wheel.member, b"not a library")
        archive.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: cyclonedds\nVersion: {wheel.VERSION}\n")
        archive.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: false\nTag: cp313-cp313-any\n")
        archive.writestr(f"{info}/RECORD", "")
    return file


def index_settings(monkeypatch: pytest.MonkeyPatch, **settings: str) -> None:
    """Set options of pip and uv by environment variables, without configuration files."""
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("UV_NO_CONFIG", "1")
    for name, value in settings.items():
        monkeypatch.setenv(f"PIP_{name}", value)
        monkeypatch.setenv(f"UV_{'DEFAULT_INDEX' if name == 'INDEX_URL' else name}", value)


def test_pip_of_a_free_threaded_python_selects_the_recorded_wheel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the tag of the ABI it selects wheels of free-threaded Pythons, and cyclonedds has none."""
    wheel = this_wheel()
    if Installer.of_environment().name == "uv":
        pytest.skip("uv has no option for it")
    commands: list[tuple[str, ...]] = []

    def download_nothing(command: tuple[str, ...], **_: object) -> subprocess.CompletedProcess[str]:
        commands.append(command)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr("subprocess.run", download_nothing)
    with pytest.raises(OutputError, match="has no "):  # nothing was downloaded
        libddsc.fetch(wheel, tmp_path)
    assert {"--abi=cp313", "--python-version=3.13"} <= set(commands[0])


def test_uv_of_free_threaded_python_is_one_line_error_naming_pip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wheel = this_wheel()
    monkeypatch.setattr(Installer, "of_environment", lambda: Installer("uv", (), (), (), ()))
    monkeypatch.setattr("sysconfig.get_config_var", lambda name: name == "Py_GIL_DISABLED")
    with pytest.raises(OutputError, match=r"^libddsc: uv selects only wheels .*`uv pip install pip`, then ") as error:
        libddsc.fetch(wheel, tmp_path)
    assert "\n" not in str(error.value) and not library.has_wheel()


def test_wheel_with_wrong_checksum_is_one_line_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wheel = this_wheel()
    fake_wheel(tmp_path, wheel)
    index_settings(monkeypatch, NO_INDEX="1", FIND_LINKS=str(tmp_path))
    with pytest.raises(OutputError, match=f"has the SHA-256 [0-9a-f]{{64}}; expected {wheel.sha256}; ") as error:
        libddsc.fetch(wheel, tmp_path)
    assert f"rosidl-py-gen libddsc --from {wheel.file}" in str(error.value) and "\n" not in str(error.value)


def test_unreachable_package_index_is_one_line_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wheel = this_wheel()
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    index_settings(monkeypatch, INDEX_URL="http://127.0.0.1:9/simple", RETRIES="0", HTTP_RETRIES="0")
    with pytest.raises(OutputError, match=r"^libddsc: the package index cannot be reached or has no ") as error:
        libddsc.fetch(wheel, tmp_path)
    assert f"rosidl-py-gen libddsc --from {wheel.file}" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (None, "No such file or directory; expected a wheel named cyclonedds-11.0.1-cp313"),
        (b"other", "the SHA-256 is d9298a10d1b0735837dc4bd85dac641b0f3cef27a47e5d53a54f2f3f5b2fcffa; expected "),
    ],
)
def test_file_other_than_recorded_wheel_is_one_line_error(
    content: bytes | None, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    this_wheel()
    file = tmp_path / "cyclonedds.whl"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SystemExit) as stopped:
        main(["libddsc", "--from", str(file)])
    printed = capsys.readouterr()
    assert stopped.value.code == 1 and not printed.out
    assert printed.err.startswith(f"error: {file}: ") and text in printed.err and printed.err.count("\n") == 1


def test_libddsc_command_installs_no_files_if_library_exists(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if not library.is_found():
        pytest.skip("no libddsc")
    monkeypatch.setattr(libddsc.InstalledLibrary, "install", partial(pytest.fail, "it is installed"))
    main(["libddsc"])
    assert capsys.readouterr().out.startswith("nothing to install: Cyclone DDS ")
    assert libddsc.InstalledLibrary.install_missing() is None


@pytest.mark.parametrize("platform", PLATFORMS, ids="-".join)
def test_recorded_wheel_in_package_index_contains_library(
    platform: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if find_spec("pip") is None:
        pytest.skip("uv downloads wheels of its own platform only")
    with monkeypatch.context() as patched:
        wheel = on_platform(patched, *platform)
    assert wheel is not None
    content, terms = libddsc.fetch(wheel, tmp_path)
    magic = {"linux": b"\x7fELF", "darwin": b"\xcf\xfa\xed\xfe", "win32": b"MZ"}[platform[0]]
    assert content.startswith(magic) and b"Eclipse Public License" in terms
    with ZipFile(libddsc.build(wheel, content, terms, tmp_path)) as built:
        assert built.read(f"rosidl_libddsc/lib/{wheel.library}") == content
        assert built.read("rosidl_libddsc/LICENSE") == terms


def test_library_is_read_from_file_with_recorded_checksum(tmp_path: Path) -> None:
    wheel = this_wheel()
    file = fake_wheel(tmp_path, wheel)
    with ZipFile(file, "a") as archive:
        archive.writestr(f"cyclonedds-{wheel.VERSION}.dist-info/licenses/LICENSE", b"terms")
    recorded = replace(wheel, sha256=hashlib.sha256(file.read_bytes()).hexdigest())
    assert libddsc.read(recorded, file) == (b"not a library", b"terms")
