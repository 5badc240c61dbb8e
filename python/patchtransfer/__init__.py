"""Parameterization transfer for isogeometric analysis, with a proof of injectivity.

The public names are listed in ``__init__.pyi``. Each is loaded when it is first used, so that a program pays for what
it works with: numerics, drawing and analysis take up to a second.
"""

from __future__ import annotations

from importlib import import_module

from . import interruption

# First of all: what follows may take a while to load.
interruption.leave_silently()

# ruff: noqa: E402
import lazy_loader

from .geometry import blocks, display, exchange, origins

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

display.draw_with(
    lambda shown: import_module(".web.notebook", __name__).svg(shown),
    lambda shown, picture: import_module(".web.notebook", __name__).html(shown, picture),
    lambda shown: import_module(".web.report", __name__).transfer_page(shown),
)
exchange.find_with(
    lambda name: getattr(import_module(".conversion" if name == "to_polynomial" else ".interop", __name__), name)
)
blocks.renumber_with(lambda block, parts: import_module(".io.gismo.renumbering", __name__).renumbered(block, parts))
origins.make_with(
    {
        "shapely": lambda *given, **options: import_module(".io.geojson", __name__).boundary_of_shapely(
            *given, **options
        ),
        "mask": lambda *given, **options: import_module(".io.mask", __name__).boundary_of_mask(*given, **options),
        "points": lambda *given, **options: import_module(".io.point_loops", __name__).from_points(*given, **options),
    }
)
