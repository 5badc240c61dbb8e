"""Parsing of XML from strangers: no document type, no entities, malformed text reported with its line."""

from __future__ import annotations

from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from ..errors import InputError
from ..limits import MAX_TAGS, at_most

__all__ = ["local_name", "parse_xml", "quoted"]


def parse_xml(data: bytes) -> Element:
    """Root element of an XML document; `InputError` on malformed text and on any DOCTYPE."""
    at_most(data.count(b"<"), MAX_TAGS, "tags", "simplify or split the file")
    # Real files have blanks before the declaration, which XML forbids.
    body = data.lstrip()
    skipped = data[: len(data) - len(body)].count(b"\n")
    try:
        root: Element = fromstring(body, forbid_dtd=True)
    except DefusedXmlException:
        raise InputError("has a DOCTYPE or entities, which are refused; delete the <!DOCTYPE ...> part") from None
    except ParseError as error:
        line, column = error.position
        what = str(error).partition(":")[0]
        raise InputError(f"malformed XML at line {line + skipped}, column {column + 1} ({what}); mend it") from None
    except (ValueError, LookupError) as error:
        raise InputError(f"not readable as XML ({error}); save it as UTF-8") from None
    return root


def local_name(element: Element) -> str:
    """Tag without its namespace."""
    return element.tag.rpartition("}")[2]


def quoted(value: str) -> str:
    """An attribute's value in quotes."""
    # Loads the standard library's network code, which only writing should have to wait for.
    from xml.sax.saxutils import quoteattr

    return quoteattr(value)
