"""A source from nothing but an outline: cross field, seamless map, T-mesh, integer program, patches.

The stages in their order, each a module: `sampling`, `mesh`, `cross_field`, `seamless_map`, `t_mesh`, `quantize`,
`assembly`, `geometry`; `portfolio` proposes layouts, `judging` compares them, `convex` is the last resort,
`parameterize` drives.
"""

from .parameterize import parameterize
from .result import Parameterization

__all__ = ["Parameterization", "parameterize"]
