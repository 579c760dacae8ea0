"""Plots of fields of messages over time, as a file, in a window or in the terminal."""
