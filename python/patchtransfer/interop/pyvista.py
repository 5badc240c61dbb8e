"""PyVista: the exact Bézier cells that are written for ParaView."""

from __future__ import annotations

from typing import Any

from ..geometry.multipatch import MultiPatch
from ..io.vtu import format_multipatch
from ..libraries import library

__all__ = ["to_pyvista"]


def to_pyvista(mp: MultiPatch) -> Any:
    """See `MultiPatch.to_pyvista`."""
    pyvista = library("pyvista", user="to_pyvista")
    reader = library("vtkmodules.vtkIOXML", "pyvista", "to_pyvista").vtkXMLUnstructuredGridReader()
    reader.ReadFromInputStringOn()
    reader.SetInputString(format_multipatch(mp))
    reader.Update()
    return pyvista.wrap(reader.GetOutput())
