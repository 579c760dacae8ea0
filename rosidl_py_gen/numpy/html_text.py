"""Texts of messages in HTML."""

from __future__ import annotations

from html import escape

from rosidl_py_gen.errors import printable


def escaped(text: str, max_length: int = 1000) -> str:
    """Return a text for HTML, of at most `max_length` characters before escaping; texts of peers are not trusted."""
    return escape(printable(text, max_length))
