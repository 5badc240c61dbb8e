"""The pages as built: links inside lead somewhere, nothing is loaded from elsewhere, examples have pictures.

Sphinx looks at references while it reads; what templates, raw HTML and other extensions write it does not see.
"""

from __future__ import annotations

from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from sphinx.util import logging

LOGGER = logging.getLogger(__name__)


class Page(HTMLParser):
    """What a page has to jump to, where it leads, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors, self.links, self.loads = {"", "top"}, set[str](), set[str]()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take a tag's id and addresses."""
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.add(given["href"])
        elif tag == "link" and "stylesheet" in given.get("rel", ""):
            self.loads.add(given["href"])
        elif tag in ("img", "script", "source", "iframe", "video") and "src" in given:
            self.loads.add(given["src"])


def checked(app: Any, exception: Exception | None) -> None:
    """Warn of what is wrong, which ends a strict build."""
    if exception is not None or app.builder.format != "html":
        return
    folder = Path(app.outdir)
    page_of = cache(Page)
    for path in sorted(folder.rglob("*.html")):
        # Parts of Sphinx's own, without a page around them.
        if "_static" in path.parts:
            continue
        page, name = page_of(path), path.relative_to(folder).as_posix()
        for address in sorted(page.links | page.loads):
            parts = urlsplit(address)
            if parts.scheme in ("http", "https", "mailto", "data") or parts.netloc:
                if address in page.loads and parts.scheme != "data":
                    LOGGER.warning("%s loads %s: put it beside the pages", name, address)
                continue
            # A folder's page is its index.
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.exists():
                LOGGER.warning("%s: no %s", name, address)
            elif target.suffix == ".html" and unquote(parts.fragment) not in page_of(target).anchors:
                LOGGER.warning("%s: %s has no such place", name, address)
        if app.config.sphinx_gallery_conf.get("plot_gallery", True) and app.config.plot_gallery not in ("0", "False"):
            example = path.parent.name == "auto_gallery" and path.stem not in ("index", "sg_execution_times")
            if example and not any(f"sphx_glr_{path.stem}_0" in image for image in page.loads):
                LOGGER.warning("%s: the example has no picture", name)


def setup(app: Any) -> dict[str, bool]:
    """Come last, when MathJax and what is downloaded are in their places."""
    app.connect("build-finished", checked, priority=900)
    return {"parallel_read_safe": True}
