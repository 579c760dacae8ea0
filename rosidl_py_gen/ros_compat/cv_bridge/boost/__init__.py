"""Replacement of the C++ extension."""
