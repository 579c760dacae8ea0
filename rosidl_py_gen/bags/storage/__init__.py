"""Readers of the files of a bag: MCAP and SQLite. `bag_files.open_files` opens them."""
