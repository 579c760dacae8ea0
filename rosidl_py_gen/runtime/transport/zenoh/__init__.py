"""Zenoh transport with the wire formats of rmw_zenoh_cpp; no other package calls Zenoh.

Jazzy and Kilted use these formats; the modules state the differences of Humble and Lyrical.
"""
