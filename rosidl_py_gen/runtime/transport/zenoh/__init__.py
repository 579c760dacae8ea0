"""Zenoh transport with the wire formats of rmw_zenoh_cpp; only this package knows Zenoh.

`keys`, `liveliness_tokens`, `qos` and `attachment` are the formats. They are those of Jazzy and Kilted; where Humble or
Lyrical differ, the modules say so.

May import: what transport may.
"""
