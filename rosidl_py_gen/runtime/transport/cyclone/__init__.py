"""DDS transport over the C functions of Cyclone DDS; only this package knows Cyclone.

Read the modules in this order; at run time each imports modules above it only:

- `c_api`, `config`, `library`: public functions of Cyclone, its configuration, and which libddsc is loaded.
- `qos`, `security`, `wakeup_pipe`: values that Cyclone takes and returns, and how it wakes up a loop.
- `private_layout`: what is read and written in Cyclone's memory (docs/internals/cyclone_memory.md 1).
- `fast_dds_interop`: peers on Fast DDS, behind the names of its package.
- `domain`, `discovery`, `endpoints`: types and topics of a domain, builtin topics, readers and writers.
- `participant`: creates all of them, and deletes them in `close`.
"""
