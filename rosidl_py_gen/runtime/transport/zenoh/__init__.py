"""Zenoh transport with the wire formats of rmw_zenoh_cpp; only this package knows Zenoh.

Formats are those of Jazzy and Kilted; where Humble or Lyrical differ, the modules say so.
"""
