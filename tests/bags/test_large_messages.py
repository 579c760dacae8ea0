"""`BagReader` reads all messages of `BagWriter`, of any size and compression ratio."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader, BagWriter, mcap_writer
from rosidl_py_gen.bags.storage import storage_api

String: Any = get_message("std_msgs/msg/String")


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_what_the_writer_writes_is_never_refused_as_too_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str
) -> None:
    """With a limit of a megabyte for that of 1023; zeros become less than a thousandth."""
    assert mcap_writer.MAX_COMPRESSED_BYTES + mcap_writer._CHUNK < storage_api.MAX_UNPACKED_BYTES
    monkeypatch.setattr(mcap_writer, "MAX_COMPRESSED_BYTES", 1 << 20)
    large = String(data="\0" * (5 << 20)).encode()
    small = String(data="x" * 1000).encode()
    path = tmp_path / "b.mcap"
    with BagWriter(path, compression=compression) as bag:
        bag.add_topic("/s", String)
        for number, data in enumerate([small, large, small, large]):
            bag.write("/s", data, number)
    with BagReader(path, max_decompressed_bytes=2 << 20) as reader:
        assert [len(item.message) for item in reader.messages(raw=True)] == [len(small), len(large)] * 2
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        shown = [chunk.compression for chunk in summary.chunk_indexes]
    assert shown == [compression, "", compression, ""]  # only what is large goes without
