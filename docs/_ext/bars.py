"""Bars in docstrings are absolute values: escaped, or reStructuredText would take ``|x|`` for a substitution."""

from __future__ import annotations

import re
from typing import Any

LITERAL = re.compile(r"(``.*?``)")


def escape_bars(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Put a backslash before every bar outside of literals and examples."""
    example = False
    for k, line in enumerate(lines):
        example = bool(line.strip()) and (example or line.lstrip().startswith(">>>"))
        if not example:
            lines[k] = "".join(
                part if part.startswith("``") else part.replace("|", r"\|") for part in LITERAL.split(line)
            )


def setup(app: Any) -> dict[str, bool]:
    """Register before numpydoc, which takes the lines apart."""
    app.connect("autodoc-process-docstring", escape_bars, priority=400)
    return {"parallel_read_safe": True}
