"""Comparison of two sets of definitions, and conversion of messages of the old set to the new one.

No module here reads files, bags or networks: definitions in, frozen results out.
"""
