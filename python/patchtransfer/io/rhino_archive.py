"""What a Rhino archive holds, as JSON on standard output: ``python -m patchtransfer.io.rhino_archive < model.3dm``.

A program of its own, for openNURBS does not return from some damaged files, and no Python can interrupt it.
"""

from __future__ import annotations

import json
import sys
from typing import Any

__all__ = ["contents"]


def contents(data: bytes) -> dict[str, Any] | None:
    """Layers and objects of an archive, curves with their NURBS form; None if it cannot be read."""
    import rhino3dm

    model = rhino3dm.File3dm.FromByteArray(data)
    if model is None:
        return None
    layers = [
        {
            "index": layer.Index,
            "name": layer.Name,
            "path": layer.FullPath,
            "visible": layer.Visible,
            "id": str(layer.Id),
            "parent": str(layer.ParentLayerId),
        }
        for layer in model.Layers
    ]
    objects = []
    for entry in model.Objects:
        attributes, geometry = entry.Attributes, entry.Geometry
        # Parts of blocks: what the drawing shows of them is a reference.
        if not attributes.IsInstanceDefinitionObject:
            objects.append(
                {
                    "kind": type(geometry).__name__,
                    "layer": attributes.LayerIndex,
                    "visible": attributes.Visible,
                    "name": attributes.Name or str(attributes.Id),
                    "curve": _nurbs(geometry) if isinstance(geometry, rhino3dm.Curve) else None,
                }
            )
    return {"layers": layers, "objects": objects}


def _nurbs(curve: Any) -> dict[str, Any]:
    nurbs = curve.ToNurbsCurve()
    if nurbs is None:
        return {"degree": 0, "knots": [], "points": []}
    # Control points times their weights, and the weights.
    points = [[p.X, p.Y, p.Z, p.W] for p in nurbs.Points]
    return {"degree": nurbs.Degree, "knots": list(nurbs.Knots), "points": points}


if __name__ == "__main__":
    print(json.dumps(contents(sys.stdin.buffer.read())))
