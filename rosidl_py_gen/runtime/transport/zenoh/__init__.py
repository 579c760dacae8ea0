"""Zenoh transport with the wire formats of rmw_zenoh_cpp; only this package knows Zenoh.

`wire_formats` has those of Jazzy and Kilted; where Humble or
Lyrical differ, the modules say so.

May import: what transport may.
"""
