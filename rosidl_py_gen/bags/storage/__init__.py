"""Readers of the two kinds of bag files, MCAP and SQLite. `bag_files.open_files` opens the files of a bag."""
