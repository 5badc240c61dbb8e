"""SVG: what attributes, style attributes and style sheets say about an element, as far as it is about being seen.

Of a style sheet the rules are read that programs for drawings write: for everything, a kind of element, a class or an
id, or a kind with a class or an id. Others, and those for certain media, are named.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

from .safe_xml import local_name

__all__ = ["Sheet", "hidden", "inherited", "painted"]

#: Properties that are looked at; the first ones are inherited.
INHERITED = ("fill", "fill-opacity", "stroke", "stroke-opacity", "stroke-width", "visibility")
OWN = ("display", "opacity", "clip-path", "mask", "transform")
SELECTOR = re.compile(r"([\w-]+|\*)?([.#][\w-]+)?")
COMMENT = re.compile(r"/\*.*?(?:\*/|$)", re.DOTALL)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")

Style = dict[str, str]


class Sheet:
    """The style sheets of a picture.

    Attributes
    ----------
    left_aside : list of str
        Selectors that are not understood.
    """

    def __init__(self, root: Element) -> None:
        self.left_aside: list[str] = []
        self._rules: dict[tuple[str, str], dict[str, tuple[int, str]]] = {}
        texts = ["".join(e.itertext()) for e in root.iter() if isinstance(e.tag, str) and local_name(e) == "style"]
        if "@import" in (text := COMMENT.sub(" ", "\n".join(texts))):
            self.left_aside.append("@import")
        for order, (selectors, declarations) in enumerate(_rules(text)):
            style = _declarations(declarations)
            for selector in map(str.strip, selectors.split(",")):
                found = SELECTOR.fullmatch(selector)
                if found is None or not selector:
                    self.left_aside.append(selector[:40])
                    continue
                key = ((found[1] or "").replace("*", ""), found[2] or "")
                self._rules.setdefault(key, {}).update({name: (order, value) for name, value in style.items()})

    def style(self, element: Element) -> Style:
        """Properties of the element's own: attributes, over which goes the sheet, over which goes its style."""
        style = {name: element.attrib[name].strip() for name in (*INHERITED, *OWN[:-1]) if name in element.attrib}
        for rule in self._matching(element):
            style.update(rule)
        style.update(_declarations(element.get("style", "")))
        return {name: value for name, value in style.items() if value != "inherit"}

    def _matching(self, element: Element) -> Iterator[Style]:
        if not self._rules:
            return
        kind = local_name(element)
        classes = [f".{name}" for name in element.get("class", "").split()]
        ids = [f"#{element.attrib['id']}"] if "id" in element.attrib else []
        # The more special rule wins, of equals the later one.
        for group in (
            [("", "")],
            [(kind, "")],
            [("", name) for name in classes],
            [(kind, name) for name in classes],
            [("", name) for name in ids],
            [(kind, name) for name in ids],
        ):
            together: dict[str, tuple[int, str]] = {}
            for key in group:
                for name, value in self._rules.get(key, {}).items():
                    together[name] = max(together.get(name, (-1, "")), value)
            yield {name: value for name, (_, value) in together.items()}


def _rules(text: str) -> Iterator[tuple[str, str]]:
    """Selectors and declarations; rules inside of others come with what they are in, which is no selector."""
    depth, head, held = 0, "", ""
    for token in re.split(r"([{}])", text):
        if token == "{":
            depth += 1
            if depth == 1:
                head = held.rpartition(";")[2].strip()
            held = ""
        elif token == "}":
            if depth == 1:
                yield head, held
            depth, held = max(depth - 1, 0), ""
        else:
            held = token


def _declarations(text: str) -> Style:
    """The properties that are looked at."""
    style = {}
    for part in text.split(";"):
        name, _, value = part.partition(":")
        if (name := name.strip().lower()) in INHERITED or name in OWN:
            style[name] = value.partition("!")[0].strip()
    return style


def inherited(parent: Mapping[str, str], own: Mapping[str, str]) -> Style:
    """What children of an element inherit."""
    return {name: value for name in INHERITED if (value := own.get(name, parent.get(name))) is not None}


def hidden(own: Mapping[str, str]) -> bool:
    """Whether an element is hidden with all that it holds."""
    return own.get("display") == "none" or _zero(own.get("opacity"))


def painted(style: Mapping[str, str]) -> tuple[bool, bool]:
    """Whether a shape with this inherited style has its inside filled, and its outline drawn."""
    if style.get("visibility", "visible") in ("hidden", "collapse"):
        return False, False
    filled = style.get("fill", "black") not in ("none", "transparent") and not _zero(style.get("fill-opacity"))
    drawn = style.get("stroke", "none") not in ("none", "transparent")
    return filled, drawn and not _zero(style.get("stroke-opacity")) and not _zero(style.get("stroke-width"))


def _zero(value: str | None) -> bool:
    """Whether a number is 0 or, as that counts for, negative."""
    found = NUMBER.match(value or "")
    return found is not None and float(found[0]) <= 0
