"""G+Smo XML: multi-patches with what else their file holds, planar domains and loose curves.

Conventions of the format, checked against G+Smo's reader: ``u`` runs fastest in ``coefs``; coefficients of NURBS are
Cartesian, their ``weights`` stand in the basis; sides are 1 u=0, 2 u=1, 3 v=0, 4 v=1; an interface is a row
``p1 s1 p2 s2 dirMap0 dirMap1 orient0 orient1``, in files before 2014 ``p1 s1 p2 s2 orient``. Its patches are `id`s
where the reader is concerned, but some writers put positions. In the plane ``dirMap`` follows from the sides, and so
does ``orient`` across the interface (1 for different ends in older files, 1 for equal ends in newer ones), so only
``orient`` along it is used, and only where the sides fit both ways.

=============  =================================================================
`numbers`      numbers of an element
`splines`      patches and curves
`multipatch`   the block that glues patches: interfaces, labels
`boundary`     planar domains
`rows`         rows of interfaces, old and new
`outside`      everything else of a file, word for word, as `cutting` cuts it out
`renumbering`  boundary conditions where patches change
`writing`      the way back
=============  =================================================================
"""

from .boundary import read_boundary
from .multipatch import read_multipatch
from .writing import format_boundary, format_multipatch

__all__ = ["format_boundary", "format_multipatch", "read_boundary", "read_multipatch"]
