"""Zstd from the package zstandard; if it is missing, from `compression.zstd` of Python 3.14 and newer.

`zstd_of_python` defines the names of zstandard that bags need.
"""

from __future__ import annotations

import sys

__all__ = ["ZstdCompressor", "ZstdDecompressor", "ZstdError", "compress", "frame_content_size"]

try:
    from zstandard import ZstdCompressor, ZstdDecompressor, ZstdError, compress, frame_content_size
except ImportError:
    if sys.version_info < (3, 14):
        raise
    from rosidl_py_gen.bags.storage.zstd_of_python import (  # type: ignore[assignment,unused-ignore]
        ZstdCompressor,
        ZstdDecompressor,
        ZstdError,
        compress,
        frame_content_size,
    )
