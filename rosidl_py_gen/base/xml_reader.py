"""Reader of XML in untrusted files, as a tree of elements that know their lines.

Document types, and so entities, are refused; the size of a file and the depth of its elements are limited.
"""

from __future__ import annotations

import os
import re
import stat
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.parsers import expat

from rosidl_py_gen.errors import DefinitionError, Diagnostic, display_path

if TYPE_CHECKING:
    from collections.abc import Iterator

_COMMENT = "!comment"
"""Value of `XmlElement.tag` for a comment."""
_MAX_FILE_BYTES = 1 << 20
"""Default maximum bytes of an XML file. The largest security policies in public repositories have some 100 kB."""
_MAX_DEPTH = 32
"""Maximum depth of elements; security policies have 6, robot descriptions 12, and metadata any depth."""
_MAX_ELEMENTS = 100_000
"""Maximum number of elements and comments in an XML file, which limits the memory that small elements take."""
_DECLARATION = re.compile(r"\A\s*<\?xml\b[^>]*\?>")


@dataclass(frozen=True, slots=True)
class XmlSource:
    """XML file from which elements were read; `lines` has the source lines for diagnostics."""

    path: str
    lines: tuple[str, ...] = ()

    def diagnostic(self, line: int, column: int, text: str) -> Diagnostic:
        source = self.lines[line - 1] if 0 < line <= len(self.lines) else ""
        return Diagnostic(self.path, line, column, text, source)


@dataclass(slots=True)
class XmlElement:
    """Element or comment of an XML file.

    Attributes:
        tag: name; with a namespace ``{URI}name``.
        attributes: values by name; a name has the form of `tag`.
        text: character data directly in the element, without the text of its children.
        line: 1-based line of the start tag; 0 for an element that is not from a file.
    """

    tag: str
    attributes: dict[str, str] = field(default_factory=dict)
    text: str = ""
    children: list[XmlElement] = field(default_factory=list)
    source: XmlSource = XmlSource("")
    line: int = 0
    column: int = 0

    @staticmethod
    def read(path: str) -> XmlElement:
        """Return the root element of an XML file.

        Raises:
            DefinitionError: the file cannot be read, is not XML, exceeds a limit, or has a document type.
        """
        data = XmlElement.read_bytes(path)
        lines = data.decode("utf-8", "replace").split("\n")
        return _TreeBuilder(XmlSource(display_path(path), tuple(lines))).parse(data)

    @staticmethod
    def read_bytes(path: str, max_bytes: int = _MAX_FILE_BYTES) -> bytes:
        """Return the content of an XML file; raises `DefinitionError` if it is not a regular file, cannot be read or is
        too large.
        """
        source = XmlSource(display_path(path))
        try:
            # A FIFO without a writer would block without O_NONBLOCK.
            descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
            try:
                if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                    raise DefinitionError(source.diagnostic(0, 0, "not a regular file; expected an XML file"))
                with os.fdopen(descriptor, "rb", closefd=False) as file:
                    data = file.read(max_bytes + 1)
            finally:
                os.close(descriptor)
        except OSError as error:
            raise DefinitionError(source.diagnostic(0, 0, f"cannot be read: {error.strerror}")) from None
        except ValueError:  # a null character
            raise DefinitionError(source.diagnostic(0, 0, "not a path of a file")) from None
        if len(data) > max_bytes:
            raise DefinitionError(source.diagnostic(0, 0, f"more than {max_bytes} bytes; split the file by includes"))
        return data

    @staticmethod
    def parse_fragment(text: str, path: str) -> XmlElement:
        """Return an element that contains all elements of an XML text; names keep their namespace prefixes.

        `path` is for errors.

        Raises:
            DefinitionError: the text is not XML, exceeds a limit, or has a document type.
        """
        # Keep line and column numbers: blank out the declaration and feed our own first line.
        content = _DECLARATION.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
        data = f"<all>\n{content}\n</all>".encode("utf-8", "replace")
        return _TreeBuilder(XmlSource(path, tuple(text.split("\n"))), is_fragment=True).parse(data)

    @property
    def is_comment(self) -> bool:
        """True for a comment, whose text is `text`."""
        return self.tag == _COMMENT

    @property
    def elements(self) -> Iterator[XmlElement]:
        """Child elements, without comments."""
        return (child for child in self.children if not child.is_comment)

    def diagnostic(self, text: str) -> Diagnostic:
        return self.source.diagnostic(self.line, self.column, text)

    def error(self, text: str) -> DefinitionError:
        return DefinitionError(self.diagnostic(text))


class _TreeBuilder:
    """Builder of the tree of one XML file, whose methods are handlers of an expat parser."""

    def __init__(self, source: XmlSource, *, is_fragment: bool = False) -> None:
        self._source = source
        self._skipped_lines = int(is_fragment)
        self._document = XmlElement("")
        self._open = [self._document]
        self._texts: list[list[str]] = [[]]
        self._count = 0
        self._parser = parser = expat.ParserCreate(namespace_separator=None if is_fragment else "}")
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text
        parser.CommentHandler = self._comment
        parser.StartDoctypeDeclHandler = self._refuse

    def parse(self, data: bytes) -> XmlElement:
        try:
            self._parser.Parse(data, True)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            raise self._error(f"not XML: {reason}", error.lineno, error.offset + 1) from None
        except (ValueError, LookupError) as error:  # an encoding that Python or expat does not know
            raise self._error(f"not XML: {error}; expected UTF-8", 1, 0) from None
        return next(self._document.elements)  # expat refuses a document without elements

    def _error(self, text: str, line: int | None = None, column: int | None = None) -> DefinitionError:
        parser = self._parser
        line = (parser.CurrentLineNumber if line is None else line) - self._skipped_lines
        column = parser.CurrentColumnNumber + 1 if column is None else column
        return DefinitionError(self._source.diagnostic(line, column, text))

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self._open) > _MAX_DEPTH:
            raise self._error(f"elements are nested more than {_MAX_DEPTH} deep")
        parser = self._parser
        element = XmlElement(
            _clark_name(name),
            {_clark_name(key): value for key, value in attributes.items()},
            source=self._source,
            line=parser.CurrentLineNumber - self._skipped_lines,
            column=parser.CurrentColumnNumber + 1,
        )
        self._add(element)
        self._open.append(element)
        self._texts.append([])

    def _end(self, name: str) -> None:
        self._open.pop().text = "".join(self._texts.pop())

    def _text(self, text: str) -> None:
        self._texts[-1].append(text)

    def _comment(self, text: str) -> None:
        self._add(XmlElement(_COMMENT, text=text, source=self._source))

    def _add(self, element: XmlElement) -> None:
        self._count += 1
        if self._count > _MAX_ELEMENTS:
            raise self._error(f"more than {_MAX_ELEMENTS} elements and comments")
        self._open[-1].children.append(element)

    def _refuse(self, *_: object) -> None:  # entities can be declared in document types only
        raise self._error("document types and entities are refused; remove the <!DOCTYPE ...>")


def _clark_name(name: str) -> str:
    return f"{{{name}" if "}" in name else name
