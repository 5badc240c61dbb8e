"""Where names in docstrings lead, so that a build that takes every reference strictly (``-n``) is clean.

Single backticks stand around names of the package and, as numpydoc asks, around parameters as well. The former link,
the latter cannot: both are written the same. All other references, ``:func:`` say, must have a target.
"""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx.domains.python import PyXRefRole

#: What the default role looks up, and what marks its references.
PLAIN = "in_backticks"


class InBackticks(PyXRefRole):
    """The default role."""

    def process_link(self, env: Any, refnode: Any, *rest: Any) -> tuple[str, str]:
        """Mark the reference, for `found`; to the domain, and to other projects, it is one to any object."""
        refnode[PLAIN], refnode["reftype"] = True, "obj"
        return super().process_link(env, refnode, *rest)


def found(app: Any, env: Any, node: Any, content: nodes.Node) -> nodes.Node | None:
    """The object of the package that has this name; else the words alone, if these are not meant to be a reference."""
    if not node.get(PLAIN):
        return None
    # A page of a module's name (`iga.poisson`) looks in the module; what it speaks of may stand beside that.
    wider = node.deepcopy()
    wider["py:module"], wider["py:class"] = "patchtransfer", None
    python = env.domains.python_domain
    return python.resolve_xref(env, node["refdoc"], app.builder, "obj", node["reftarget"], wider, content) or content


def setup(app: Any) -> dict[str, bool]:
    """Come after intersphinx, which knows names of other projects."""
    app.add_role_to_domain("py", PLAIN, InBackticks())
    app.connect("missing-reference", found, priority=900)
    return {"parallel_read_safe": True}
