"""Replacements of functions that old versions of numpy do not have."""

from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
