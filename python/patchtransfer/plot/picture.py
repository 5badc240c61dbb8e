"""Figures that show themselves."""

from __future__ import annotations

import sys
import threading
from io import BytesIO
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from ..errors import InputError

__all__ = ["Picture", "rendered"]

#: Dots per inch in a notebook.
SCREEN_DPI = 110
#: Bytes of an SVG picture that a notebook keeps; of larger ones it shows the PNG.
LARGEST_SVG = 1_000_000
_settings_lock = threading.Lock()


class Picture(Figure):
    """A matplotlib figure made without pyplot, which notebooks show as it is and scripts in a window."""

    def _repr_png_(self) -> bytes:
        return rendered(self, "png", SCREEN_DPI)

    def _repr_svg_(self) -> str | None:
        """None for pictures that would make a notebook large: they are shown as PNG."""
        text = rendered(self, "svg", SCREEN_DPI)
        return text.decode() if len(text) <= LARGEST_SVG else None

    def show(self, warn: bool = True) -> None:
        """Show the figure: below the cell of a notebook, else in a window of matplotlib's backend until it is closed.

        Raises
        ------
        InputError
            Where there is neither a notebook nor a backend with windows.
        """
        if "IPython" in sys.modules:
            from IPython import get_ipython
            from IPython.display import display

            if get_ipython() is not None:
                display(self)
                return
        from matplotlib import pyplot

        # A figure gets a window by taking over that of an empty one.
        manager = pyplot.figure().canvas.manager
        if manager is None or manager.canvas.required_interactive_framework is None:
            pyplot.close()
            raise InputError(
                f"matplotlib's backend {matplotlib.get_backend()!r} has no windows to show a figure in; "
                "write it with pt.plot.savefig, or take a backend that has (pip install PyQt6, or Tk)"
            )
        manager.canvas.figure = self
        self.set_canvas(manager.canvas)
        pyplot.show(block=True)


def rendered(figure: Figure, kind: str, dpi: int) -> bytes:
    """A figure as PNG, SVG or PDF: the same bytes each time, text as text."""
    metadata: dict[str, Any] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    # SVG ids are random unless salted, and only through this setting.
    settings: Any = {"svg.hashsalt": "patchtransfer", "svg.fonttype": "none", "pdf.fonttype": 42}
    known: Any = matplotlib.rcParams
    buffer = BytesIO()
    with _settings_lock:
        before = {name: known[name] for name in settings}
        known.update(settings)
        try:
            figure.savefig(buffer, format=kind, dpi=dpi, metadata=metadata, facecolor="white")
        finally:
            known.update(before)
    return buffer.getvalue()
