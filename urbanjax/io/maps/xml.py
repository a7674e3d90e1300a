"""XML files read without trust: bounded in size, and every fault an error that names file and element."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, no_type_check
from xml.etree.ElementTree import Element, TreeBuilder  # what is filled; only defusedxml parses

import numpy as np

from urbanjax.io.files import content
from urbanjax.types import FileError

LARGEST_FILE = 64 * 2**20  # bytes
MOST_ELEMENTS = 4_000_000
DEEPEST = 64  # elements within each other
SPEED_LIMITS = (0.1, 1e3)  # that a map may state, in the unit that it states them in
LASTS = 1e6  # s (or time steps), most that a phase of a signal lasts
ID = 2**53  # beyond either sign of it no id is exact as a JSON number
FARTHEST = 1e8  # m (or degrees, or seconds): no number of a map is larger


class MapError(FileError):
    """A map file is malformed, or holds what no map can hold."""


class _Bounded(TreeBuilder):
    """A tree builder that stops at the caps."""

    def __init__(self) -> None:
        super().__init__()
        self.count = self.depth = 0

    def start(self, tag: Any, attrs: Any, /) -> Element:
        self.count, self.depth = self.count + 1, self.depth + 1
        if self.depth > DEEPEST:
            raise ValueError(f"<{tag}> lies more than {DEEPEST} elements deep")
        if self.count > MOST_ELEMENTS:
            raise ValueError(f"more than {MOST_ELEMENTS} elements")
        return super().start(tag, attrs)

    def end(self, tag: Any, /) -> Element:
        self.depth -= 1
        return super().end(tag)


@no_type_check
@dataclass(frozen=True)
class Xml:
    """A parsed file; its methods read elements and raise MapError with the file, the element and what is wrong."""

    path: Path
    root: Element

    def fail(self, element: Element, message: str) -> MapError:
        """The error to raise about an element."""
        return MapError(f"{self.path}: {name(element)}: {message}")

    def attribute(self, element: Element, key: str, default: str | None = None) -> str:
        """An attribute's text; without a default it must be there."""
        value = element.get(key, default)
        if value is None:
            raise self.fail(element, f"the attribute {key!r} is missing")
        return value

    def child(self, element: Element, tag: str) -> Element:
        """The first child with the tag; it must be there."""
        found = element.find(tag)
        if found is None:
            raise self.fail(element, f"has no <{tag}>")
        return found

    def text(self, element: Element, tag: str, owner: Element | None = None) -> str:
        """The stripped text of the first child with the tag, which must be there (`owner`: the element to name)."""
        text = (element.findtext(tag) or "").strip()
        if not text:
            raise self.fail(element if owner is None else owner, f"<{element.tag}> has no <{tag}> with a value")
        return text

    def number(self, element: Element, text: str, what: str, low: float = -FARTHEST, high: float = FARTHEST) -> float:
        """The text as a finite number within bounds; `what` names it in the error."""
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise self.fail(element, f"{what} is {text[:40]!r}, expected a number from {low:g} to {high:g}")
        return value

    def integer(self, element: Element, text: str, what: str, low: int = 0, high: int = ID) -> int:
        """The text as a whole number within bounds."""
        stripped = text.strip()
        digits = stripped[1:] if stripped[:1] == "-" else stripped
        value = int(stripped) if digits.isascii() and digits.isdigit() and len(digits) < 20 else None
        if value is None or not low <= value <= high:
            raise self.fail(element, f"{what} is {text[:40]!r}, expected a whole number from {low} to {high}")
        return value

    def id(self, element: Element, key: str = "id") -> int:
        """A whole-number id in an attribute."""
        return self.integer(element, self.attribute(element, key), key, low=-ID)

    def points(self, owner: Element, pairs: Iterable[tuple[str | None, str | None]], what: str) -> np.ndarray:
        """Points [n, 2] from pairs of texts."""
        pairs = list(pairs)
        try:
            points = np.array([(float(x or ""), float(y or "")) for x, y in pairs]).reshape(-1, 2)
        except ValueError:
            points = np.full((1, 2), np.nan)
        if not np.all(np.abs(points) <= FARTHEST):
            raise self.fail(owner, f"{what} holds a coordinate that is no number within {FARTHEST:g}")
        return points


def name(element: Element) -> str:
    """How an error names an element: its tag and id.

    Args: element of a parsed file.
    """
    key = next((k for k in ("id", "ref", "k", "from") if k in element.attrib), None)
    return f"<{element.tag}>" if key is None else f'<{element.tag} {key}="{element.attrib[key][:60]}">'


def parse(path: str | Path) -> Xml:
    """The tree of an XML file.

    Args: path of the file. Raises MapError for what is no well-formed XML, holds entities or exceeds the caps.
    """
    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import DefusedXMLParser, ParseError

    path = Path(path)
    data = content(path)
    if len(data) > LARGEST_FILE:
        raise MapError(f"{path}: {len(data)} bytes are more than the {LARGEST_FILE} that a map may have")
    parser = DefusedXMLParser(target=_Bounded(), forbid_dtd=True)
    try:
        parser.feed(data)
        return Xml(path, parser.close())
    except ParseError as error:
        raise MapError(
            f"{path}: no well-formed XML ({error}): a map is a CommonRoad, Lanelet2 or SUMO file, or a track's .csv"
        ) from error
    except DefusedXmlException as error:
        raise MapError(f"{path}: declares entities or a document type, which no map needs") from error
    except (ValueError, LookupError) as error:
        raise MapError(f"{path}: {error}") from error
