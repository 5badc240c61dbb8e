"""MFEM NURBS meshes (``MFEM NURBS mesh v1.0`` and ``v1.1``), read and written.

Conventions, from MFEM's reader: a patch is an element with four vertices, its corners (0, 0), (1, 0), (1, 1), (0, 1) in
u and v. Two patches that name the same two vertices are glued there. A boundary is a list of edges with attributes. An
edge says which knot vector runs along it, from its first vertex to its second. The rest is one of two things:

- ``knotvectors``, then weights and points of all degrees of freedom: those of the vertices, of the insides of edges
  (from the lower vertex to the higher), of the insides of patches (u fastest); or
- ``patches``, each with its own knots and control points (u fastest), multiplied by their weights
  (``controlpoints``) or not (``controlpoints_cartesian``).

What MFEM has no place for stands in comments, which MFEM skips: names of attributes, and patches written with u and v
exchanged because they are left-handed (in MFEM their integrals would be negative).
"""

from __future__ import annotations

from .reading import looks_like_mfem, read_boundary, read_multipatch
from .writing import format_multipatch

__all__ = ["format_multipatch", "looks_like_mfem", "read_boundary", "read_multipatch"]
