"""Readers of the files of a bag: MCAP and SQLite."""
