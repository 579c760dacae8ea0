"""The files of a bag, opened, each with what reads it; and where a bag may be cut into parts of about one size."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.bags.remote import unreachable_as_error
from rosidl_py_gen.bags.storage.file_compression import CompressedMessages, files_of, unpacked
from rosidl_py_gen.bags.storage.mcap_file import McapFile
from rosidl_py_gen.bags.storage.sqlite_file import SqliteFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from contextlib import ExitStack
    from pathlib import Path

    from rosidl_py_gen.bags.common import DamagedPart
    from rosidl_py_gen.bags.storage.storage_api import Storage


def open_files(
    path: Path,
    kept: ExitStack,
    validate_crcs: bool,
    max_bytes: int,
    on_skipped: Callable[[DamagedPart], None] | None = None,
) -> tuple[list[Path], list[Storage], dict[tuple[str, str], str]]:
    """The files of a bag, what reads them, which `kept` closes, and known hashes by topic and type.

    Raises:
        BagError: damaged beyond reading, or of an unknown kind. OSError: a file cannot be opened.
    """
    found: list[Storage] = []
    with unreachable_as_error(path):
        files, has_packed_messages, hashes = files_of(path)
        for file in files:
            plain = unpacked(file, kept, max_bytes)
            storage = (
                SqliteFile(plain) if plain.suffix == ".db3" else McapFile(plain, validate_crcs, max_bytes, on_skipped)
            )
            kept.callback(storage.close)
            found.append(CompressedMessages(storage, file, max_bytes) if has_packed_messages else storage)
    return files, found, hashes


def split_times(files: Iterable[Storage], size: int) -> list[int]:
    """Log times that cut a bag into parts of about so many stored bytes; none where it is not larger."""
    found: list[int] = []
    held, begin = 0, None
    for first, stored in sorted(part for file in files for part in file.parts()):
        begin = first if begin is None else begin
        if held >= size and first > begin:
            found.append(first)
            held, begin = 0, first
        held += stored
    return found
