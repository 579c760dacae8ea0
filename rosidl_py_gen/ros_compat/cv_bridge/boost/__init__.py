"""Replacement of cv_bridge's C++ extension, written in Python."""
