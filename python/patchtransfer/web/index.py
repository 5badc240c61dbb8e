"""The page of a batch: a row a target, failures first, with small pictures and links to the files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from .. import io
from ..batch import BatchRow
from ..errors import TransferError
from .figure import Figure, boundary_figure, model_figure
from .report import render

__all__ = ["index_page"]


class Entry(NamedTuple):
    """A row of the page: a target, its picture or None, and the addresses of its files."""

    row: BatchRow
    name: str
    figure: Figure | None
    model: str | None
    report: str | None


def index_page(source: str | Path, rows: Sequence[BatchRow], folder: Path, command: str | None = None) -> str:
    """The page of a batch.

    Parameters
    ----------
    source : path
    rows : sequence of BatchRow
    folder : Path
        Where the page will be: links are relative to it.
    command : str, optional
        The command line that makes it again.

    Returns
    -------
    str
        A whole HTML document: pictures are of the results, of failed targets of their outlines.
    """
    failed_first = sorted(rows, key=lambda row: row.ok)
    return render(
        "index.html.j2",
        title="Batch",
        source=os.path.basename(source),
        entries=[_entry(row, folder, f"target-{k}") for k, row in enumerate(failed_first)],
        done=sum(row.ok for row in rows),
        command=command,
    )


def _entry(row: BatchRow, folder: Path, name: str) -> Entry:
    report = None if row.output is None else str(Path(row.output).with_suffix(".report.json"))
    return Entry(
        row,
        os.path.basename(row.target),
        _figure(row, name),
        _address(row.output, folder),
        _address(report, folder),
    )


def _figure(row: BatchRow, name: str) -> Figure | None:
    # A picture is no reason to fail: what is wrong with a file is the row's own error.
    with suppress(TransferError):
        if row.output is not None:
            return model_figure(io.read(row.output), name, os.path.basename(row.target), detail=False)[0]
        return boundary_figure(io.read_boundary(row.target), name, os.path.basename(row.target))
    return None


def _address(path: str | None, folder: Path) -> str | None:
    """The path as seen from the page, for a link."""
    if path is None or not os.path.exists(path):
        return None
    try:
        near = os.path.relpath(path, folder)
    except ValueError:
        # Another drive: a link would have to be absolute.
        return None
    # The dot keeps a name with a colon from being read as a scheme.
    return quote(os.path.join(os.curdir, near).replace(os.sep, "/"))
