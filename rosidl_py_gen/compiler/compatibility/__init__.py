"""Comparison of two sets of message definitions, and conversion of messages of the old set to the new set.

The modules of this package read no files, bags or networks: functions take definitions and return immutable results.
"""
