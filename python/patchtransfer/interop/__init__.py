"""Models as objects of other libraries, and back: a library a module, loaded when one of its functions is called.

The functions here are methods of `MultiPatch`; nothing else is public.
"""

from __future__ import annotations

from .geomdl import from_geomdl, to_geomdl
from .meshio import to_meshio
from .nutils import to_nutils
from .pyvista import to_pyvista
from .splinepy import from_splinepy, to_splinepy

__all__ = ["from_geomdl", "from_splinepy", "to_geomdl", "to_meshio", "to_nutils", "to_pyvista", "to_splinepy"]
