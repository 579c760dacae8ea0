"""Parser of INI files such as setup.cfg, as `configparser` reads them, in time that is linear in the file's size."""

from __future__ import annotations

from rosidl_py_gen.errors import RosidlError


class IniSyntaxError(RosidlError):
    """Error of a line in an INI file that is neither a section nor an option."""


def parse_ini(text: str) -> dict[str, dict[str, str]]:
    """Return the options of an INI file by section and name, with the lines of a value joined by line breaks.

    Raises `IniSyntaxError` for a line that is neither a section nor an option.
    """
    sections: dict[str, dict[str, list[str]]] = {}
    options: dict[str, list[str]] | None = None
    lines: list[str] | None = None
    indent = 0
    for number, line in enumerate(text.split("\n"), 1):
        stripped = line.strip()
        if stripped.startswith(("#", ";")):
            continue
        if not stripped:
            if lines is not None:
                lines.append("")
            continue
        margin = len(line) - len(line.lstrip())
        if lines is not None and margin > indent:
            lines.append(stripped)
            continue
        indent = margin
        if stripped.startswith("[") and "]" in stripped:
            options = sections.setdefault(stripped[1 : stripped.rindex("]")], {})
            lines = None
            continue
        name, value = _option(stripped)
        if options is None:
            raise IniSyntaxError(f"line {number}: got {stripped[:80]!r}; expected a section such as [install]")
        if not name:
            raise IniSyntaxError(f"line {number}: got {stripped[:80]!r}; expected NAME = VALUE")
        lines = options[name] = [value]
    return {
        section: {name: "\n".join(lines).rstrip() for name, lines in values.items()}
        for section, values in sections.items()
    }


def _option(line: str) -> tuple[str, str]:
    """Return name and value of an option line in an INI file; both are "" if the line has no delimiter."""
    positions = [position for position in (line.find("="), line.find(":")) if position >= 0]
    if not positions:
        return "", ""
    return line[: min(positions)].strip(), line[min(positions) + 1 :].strip()
