"""DDS transport over the C functions of Cyclone DDS; only this package knows Cyclone.

Read the modules in this order; at run time each imports modules above it only:

- `library`: public functions of Cyclone, its configuration, and which libddsc is loaded.
- `security`: DDS Security of a participant.
- `private_layout`: what is read and written in Cyclone's memory (docs/internals/cyclone_memory.md 1).
- `fast_dds_interop`: peers on Fast DDS, behind the names of its package.
- `domain`, `endpoints`: types and topics of a domain; readers and writers, QoS, and how Cyclone wakes up a loop.
- `discovery`: builtin topics.
- `participant`: creates all of them, and deletes them in `close`.
"""
