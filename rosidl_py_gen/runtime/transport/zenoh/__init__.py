"""Zenoh transport with the wire formats of rmw_zenoh_cpp; only this package knows Zenoh.

The formats are used by Jazzy and Kilted; where Humble or Lyrical differ, the modules state it.
"""
