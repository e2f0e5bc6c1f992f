"""Zstandard: of the standard library from Python 3.14 on, before that by `backports.zstd`."""

from __future__ import annotations

import sys

if sys.version_info >= (3, 14):
    from compression.zstd import ZstdCompressor, ZstdDecompressor, ZstdError, compress, decompress
    from compression.zstd import open as open_file
else:
    from backports.zstd import ZstdCompressor, ZstdDecompressor, ZstdError, compress, decompress
    from backports.zstd import open as open_file

MAGIC = b"\x28\xb5\x2f\xfd"  # how what is compressed begins

__all__ = [
    "MAGIC",
    "ZstdCompressor",
    "ZstdDecompressor",
    "ZstdError",
    "compress",
    "decompress",
    "open_file",
]
