"""URDF text to a small tree with line numbers; entities, xacro and monsters are refused."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from dmoc.errors import RobotError
from dmoc.input_file import content_of

_MOST_BYTES = 20_000_000
_MOST_DEPTH = 60
_MOST_ELEMENTS = 200_000


@dataclass
class Element:
    """A tag with attributes, children, and the line it starts on."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, tag: str) -> list[Element]:
        """Children of that tag."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Element | None:
        """First child of that tag."""
        return next(iter(self.all(tag)), None)


class _Refused(Exception):
    def __init__(self, code: str, value: str, legal: str, fix: str) -> None:
        super().__init__(code)
        self.parts = (code, value, legal, fix)


def read_xml(path: Path, text: str | None = None) -> Element:
    """The root element of the file (or of `text`, which was made from it).

    Errors: `RobotError` with one fault and its line.
    """

    def refuse(code: str, value: str, legal: str, fix: str, line: int | None = None) -> RobotError:
        return RobotError.of(
            code, file=str(path), line=line, value=value[:200], legal=legal, fix=fix
        )

    try:
        if path.stat().st_size > _MOST_BYTES:
            raise refuse(
                "urdf-large",
                f"{path.stat().st_size} bytes",
                f"<= {_MOST_BYTES}",
                "keep shapes in mesh files",
            )
        content = content_of(path, _MOST_BYTES) if text is None else text.encode()
    except OSError as error:
        raise refuse("robot-missing", str(error), "a readable file", "check the path") from error
    reader = _Reader()
    try:
        reader.parser.Parse(content, True)
    except expat.ExpatError as error:
        raise refuse(
            "urdf-syntax",
            expat.ErrorString(error.code),
            "well-formed XML",
            "mend the syntax of this line",
            error.lineno,
        ) from error
    except _Refused as error:
        raise refuse(*error.parts, line=reader.parser.CurrentLineNumber) from error
    except (ValueError, LookupError) as error:  # an unknown encoding
        raise refuse("urdf-syntax", str(error), "UTF-8 XML", "save it as UTF-8") from error
    assert reader.root is not None
    return reader.root


class _Reader:
    """Builds the tree from expat's events."""

    def __init__(self) -> None:
        self.root: Element | None = None
        self._open: list[Element] = []
        self._count = 0
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.CharacterDataHandler = self._words

    def _doctype(self, *_: object) -> None:
        raise _Refused(
            "urdf-entity",
            "a document type declaration",
            "plain XML without entities",
            "remove <!DOCTYPE ...> and write the entities out",
        )

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if tag.startswith("xacro:"):
            raise _Refused(
                "urdf-xacro",
                f"<{tag}>",
                "plain URDF",
                "call the file .xacro: then it is expanded",
            )
        if len(self._open) >= _MOST_DEPTH or self._count > _MOST_ELEMENTS:
            raise _Refused(
                "urdf-large",
                f"{self._count} elements, {len(self._open)} deep",
                f"<= {_MOST_ELEMENTS} elements, {_MOST_DEPTH} deep",
                "simplify the robot",
            )
        element = Element(tag, attributes, self.parser.CurrentLineNumber)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _end(self, _: str) -> None:
        self._open.pop()

    def _words(self, text: str) -> None:
        if len(self._open[-1].text) < 200:
            self._open[-1].text += text
