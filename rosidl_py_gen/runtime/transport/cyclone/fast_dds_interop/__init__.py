"""Interoperation with peers on Fast DDS that Cyclone lacks: sample identities, and samples sent before the match.

What a caller needs, by the object that it asks:

- `FastDdsSupport`, one for the process: which of these features the loaded library has, and why others are missing.
- `FastDdsInterop`, one for each open domain: prepares types of services so that their samples carry sample identities.
- `FastDdsPeers`, one for each participant: knows which peers are on Fast DDS, requests the samples that they sent
  before the match, and warns about peers that cannot be served.

Only `transport/cyclone` imports this package, and only these names. Source: docs/internals/dds.md 2 to 6;
what is read and written in Cyclone's memory: docs/internals/cyclone_memory.md 1.
"""

from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.peers import FastDdsPeers
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import (
    FastDdsInterop,
    FastDdsSupport,
    SampleIdentities,
)

__all__ = ["FastDdsInterop", "FastDdsPeers", "FastDdsSupport", "SampleIdentities"]
