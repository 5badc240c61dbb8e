"""What is edited in the studio, and its certified result."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..errors import InfeasibleTargetError, InputError, TransferError
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..geometry.outline import Outline
from ..gradients.filled import Filled
from ..gradients.frozen import Frozen
from ..gradients.outline_map import OutlineMap
from ..numeric.arrays import FloatArray
from ..pipeline.options import MISSED, Options
from ..pipeline.plan import TransferPlan
from ..pipeline.result import TransferResult, failure_of
from ..proof.certificate import Certificate, check_boundary
from ..sources.auto_layout import parameterize
from .editing import PointAddress, addresses, check_address, control_points, pulled
from .vertices import Base, VertexAddress, inner_vertices, no_place, with_vertices

__all__ = ["Drag", "Edited", "Landmark", "Session", "Shown"]

#: Steps that can be taken back.
MOST_UNDO = 200
#: Seconds for a transfer: whoever drags does not wait for longer.
TIME_LIMIT = 10.0

Point = tuple[float, float]


class Landmark(NamedTuple):
    """A pair of corresponding boundary points."""

    source: Point
    target: Point


class Edited(NamedTuple):
    """What can be undone: the target, the landmarks and the inner layout vertices that were moved, in a fixed order."""

    target: Boundary
    landmarks: tuple[Landmark, ...]
    vertices: tuple[tuple[VertexAddress, Point], ...] = ()

    @property
    def places(self) -> dict[VertexAddress, Point]:
        """Where the vertices were moved to."""
        return dict(self.vertices)

    def with_vertex(self, vertex: VertexAddress, to: Point | None) -> Edited:
        """The same with a vertex at another place, or where it comes to lie by itself."""
        places = {known: place for known, place in self.vertices if known != vertex}
        if to is not None:
            places[vertex] = to
        return self._replace(vertices=tuple(sorted(places.items())))


class Shown(NamedTuple):
    """What there is to see: a map, or why there is none.

    Attributes
    ----------
    model : MultiPatch or None
        The result; the last one there was where `error` says that there is none.
    certificate : Certificate or None
    error : str or None
    places : list of points
        Where the boundary itself rules a map out.
    seconds : float
    live : bool
        Whether it is a map of a drag, under held rows, which is made anew when the point is dropped.
    """

    model: MultiPatch | None
    certificate: Certificate | None
    error: str | None
    places: list[Point]
    seconds: float
    live: bool


class Drag(NamedTuple):
    """What is held: what was there when it was grabbed, and the map that follows, if there is one.

    A control point of the target with the part of the loop that it draws along, or a layout vertex, which has no
    outline to follow.
    """

    at: PointAddress | VertexAddress
    before: Edited
    reach: float
    frozen: Frozen | None
    outline: OutlineMap | None


class Session:
    """A source, an edited target with landmarks, and the result.

    Parameters
    ----------
    source : MultiPatch
    target : Boundary
    landmarks : sequence of Landmark, optional
    continuity : {"c0", "c1", "g1"}, default "c1"
    options
        Of `patchtransfer.transfer`.

    Attributes
    ----------
    edited : Edited
    result : TransferResult or None
        Of the edited target; None where there is none.
    shown : Shown
    """

    def __init__(
        self,
        source: MultiPatch,
        target: Boundary,
        landmarks: FloatArray | None = None,
        continuity: str = "c1",
        **options: Any,
    ) -> None:
        self.source, self._options = source, options
        self._plan = TransferPlan(source, continuity)
        self._fit_tolerance = Options(**options).fit_tolerance
        self.edited = Edited(target, _pairs(landmarks))
        self._past: list[Edited] = []
        self._future: list[Edited] = []
        self._drag: Drag | None = None
        self._near: Filled | None = None
        self._base: tuple[Boundary, tuple[Landmark, ...], Base] | None = None
        self._source_outlines = [Outline(loop) for loop in source.boundary().loops]
        self.result: TransferResult | None = None
        self.shown = Shown(None, None, None, [], 0.0, False)
        self.refresh()

    @classmethod
    def of_outline(
        cls,
        outline: Boundary,
        target: Boundary | None = None,
        landmarks: FloatArray | None = None,
        continuity: str = "c1",
        **options: Any,
    ) -> Session:
        """A session whose source is parameterized from an outline, which is the target where no other is given."""
        source = parameterize(outline).multipatch
        return cls(source, outline if target is None else target, landmarks, continuity, **options)

    @property
    def landmark_rows(self) -> FloatArray | None:
        """Rows (xs, ys, xt, yt), None without landmarks."""
        rows = [[*pair.source, *pair.target] for pair in self.edited.landmarks]
        return np.array(rows) if rows else None

    @property
    def handles(self) -> list[PointAddress]:
        """Control points of the target that can be dragged."""
        return addresses(self.edited.target)

    @property
    def held(self) -> bool:
        """Whether a point is held, so that the result is not yet that of the target."""
        return self._drag is not None

    def refresh(self) -> None:
        """The result of what is edited."""
        begin = time.perf_counter()
        target, near = self.edited.target, self._near
        self._near = None
        try:
            base = self._transferred()
            result = base.result
            if self.edited.vertices and result.succeeded:
                result, self._near = with_vertices(base, self.edited.places, near)
        except TransferError as error:
            self.result = None
            self._show_none(str(error), target, begin)
            return
        self.result = result
        failure = failure_of(result)
        places = _failing(result.multipatch, result.certificate)
        self.shown = Shown(
            result.multipatch,
            result.certificate,
            None if failure is None else str(failure),
            places,
            time.perf_counter() - begin,
            False,
        )

    def grab(self, at: PointAddress, reach: float = 0.0) -> None:
        """Take hold of a control point of the target; `reach` is the part of the loop's length that it draws along.

        Raises
        ------
        InputError
            When there is no such point.
        """
        check_address(self.edited.target, at)
        frozen = outline = None
        if self.result is not None and self.result.succeeded:
            try:
                base = self._transferred()
                frozen = base.held(list(self.edited.places)) if self.edited.vertices else base.frozen
                outline = frozen.outline(self.edited.target)
            except TransferError:
                # Degenerate maps may have no derivative: such drags are transferred step by step.
                frozen = outline = None
        self._drag = Drag(at, self.edited, reach, frozen, outline)

    def take(self, vertex: VertexAddress) -> None:
        """Take hold of an inner layout vertex of the result.

        Raises
        ------
        InputError
            When there is no such vertex, or it cannot be moved.
        TransferError
            When there is no certified map to start from.
        """
        base = self._transferred()
        if not base.result.succeeded:
            raise InputError("there is no certified map whose vertices could be moved; mend target or landmarks first")
        frozen = base.held(list(self.edited.with_vertex(vertex, (0.0, 0.0)).places))
        self._drag = Drag(vertex, self.edited, 0.0, frozen, None)

    def release(self, vertex: VertexAddress) -> None:
        """Let a vertex that was moved go where the distortion is least."""
        if vertex not in self.edited.places:
            raise InputError(f"the layout vertex {vertex} was not moved")
        self._change(self.edited.with_vertex(vertex, None))

    @property
    def vertices(self) -> dict[VertexAddress, Point]:
        """Inner layout vertices of what is shown, and where they are."""
        model = self.shown.model
        if model is None:
            return {}
        points = model.topology.coordinates
        found = {vertex: (float(points[k, 0]), float(points[k, 1])) for vertex, k in inner_vertices(model).items()}
        return found | {vertex: place for vertex, place in self.edited.vertices if vertex in found}

    def drag(self, to: Point) -> None:
        """Move what is held; what is shown follows under held rows."""
        if self._drag is None:
            raise InputError("no point is held; grab one first")
        begin = time.perf_counter()
        held = self._drag
        if isinstance(held.at, VertexAddress):
            self.edited = self.edited.with_vertex(held.at, to)
        else:
            self.edited = self.edited._replace(target=pulled(held.before.target, held.at, to, held.reach))
        target = self.edited.target
        if held.frozen is None:
            self.refresh()
            return
        boundary = held.frozen.boundary if held.outline is None else held.outline(control_points(target))
        pins = np.array(list(self.edited.places.values())).reshape(-1, 2)
        try:
            filled = held.frozen.fill(boundary, near=self._near, pins=pins)
        except InfeasibleTargetError as error:
            self._show_none(str(error).removeprefix("fill: "), target, begin)
            return
        certificate = filled.certificate
        if not certificate.injective and self.edited.vertices:
            # Patches may be turned over, which is no picture of anything: the last map stays.
            self._show_none(no_place(certificate), target, begin)
            return
        self._near = filled if certificate.injective else None
        why = None if certificate.injective else "; ".join(certificate.reasons[:2])
        places = _failing(filled.multipatch, certificate)
        missed, where = _farthest(filled.multipatch.boundary(), target) if held.outline is not None else (0.0, to)
        off = missed / target.diameter
        if why is None and off > MISSED * self._fit_tolerance:
            # A proof of another shape is none of this one.
            why = f"the map cannot follow so far ({off:.1e} of the diameter off): drop the point to fit it anew"
            places = [where]
        self.shown = Shown(filled.multipatch, certificate, why, places, time.perf_counter() - begin, True)

    def drop(self) -> None:
        """Let go of the point: the result of the target as it is now, which can be undone."""
        if self._drag is None:
            return
        held, self._drag = self._drag, None
        if not isinstance(held.at, VertexAddress):
            # What follows is another transfer's map.
            self._near = None
        if self.edited != held.before:
            self._remember(held.before)
        self.refresh()

    def edit(self, target: Boundary, landmarks: FloatArray | None) -> None:
        """Put another target and other landmarks, rows (xs, ys, xt, yt), in place; a point that is held is let go."""
        if self._drag is not None:
            # What can be undone is the target before it was dragged.
            self.edited, self._drag = self._drag.before, None
        # Vertices were moved on the target that there was.
        vertices = self.edited.vertices if target == self.edited.target else ()
        self._change(Edited(target, _pairs(landmarks), vertices))

    def add_landmark(self, source: Point, target: Point) -> None:
        """Add a pair of points, each moved to the boundary."""
        pair = Landmark(self._on_source(source), self._on_target(target))
        self._change(self.edited._replace(landmarks=(*self.edited.landmarks, pair)))

    def move_landmark(self, number: int, on: str, to: Point) -> None:
        """Move one end of a pair, "source" or "target", along the boundary."""
        pairs = list(self.edited.landmarks)
        pair = self._pair(number)
        place = self._on_source(to) if on == "source" else self._on_target(to)
        pairs[number] = pair._replace(source=place) if on == "source" else pair._replace(target=place)
        self._change(self.edited._replace(landmarks=tuple(pairs)))

    def remove_landmark(self, number: int) -> None:
        """Take a pair away."""
        self._pair(number)
        kept = tuple(pair for k, pair in enumerate(self.edited.landmarks) if k != number)
        self._change(self.edited._replace(landmarks=kept))

    def undo(self) -> None:
        """Take the last change back."""
        self._travel(self._past, self._future)

    def redo(self) -> None:
        """Make the change again that was taken back last."""
        self._travel(self._future, self._past)

    @property
    def can_undo(self) -> tuple[bool, bool]:
        """Whether there is something to undo, and to redo."""
        return bool(self._past), bool(self._future)

    def _transferred(self) -> Base:
        """The transfer of target and landmarks as they are now, the last one kept."""
        key = self.edited.target, self.edited.landmarks
        if self._base is None or self._base[:2] != key:
            options = {"time_limit": TIME_LIMIT, **self._options, "on_failure": "return"}
            self._base = *key, Base(self._plan.transfer(key[0], self.landmark_rows, **options))
        return self._base[2]

    def _change(self, edited: Edited) -> None:
        self._near = None
        before, self.edited = self.edited, edited
        self._remember(before)
        self.refresh()

    def _remember(self, before: Edited) -> None:
        self._past = [*self._past[1 - MOST_UNDO :], before]
        self._future = []

    def _travel(self, there: list[Edited], back: list[Edited]) -> None:
        self._drag = self._near = None
        if there:
            back.append(self.edited)
            self.edited = there.pop()
            self.refresh()

    def _pair(self, number: int) -> Landmark:
        if not 0 <= number < len(self.edited.landmarks):
            raise InputError(f"there is no landmark {number}")
        return self.edited.landmarks[number]

    def _on_source(self, point: Point) -> Point:
        return _nearest(self._source_outlines, point)

    def _on_target(self, point: Point) -> Point:
        return _nearest([Outline(loop) for loop in self.edited.target.loops], point)

    def _show_none(self, error: str, target: Boundary, begin: float) -> None:
        seconds = time.perf_counter() - begin
        model = self.shown.model
        # Vertices that are not where the last map has them.
        there = {} if model is None else inner_vertices(model)
        astray = [
            place
            for vertex, place in self.edited.vertices
            if model is None
            or vertex not in there
            or tuple(model.topology.coordinates[there[vertex]].tolist()) != place
        ]
        self.shown = Shown(model, None, error, [*_meetings(target), *astray], seconds, self._drag is not None)


def _pairs(landmarks: FloatArray | None) -> tuple[Landmark, ...]:
    rows = [] if landmarks is None else np.asarray(landmarks, float).tolist()
    return tuple(Landmark((a, b), (c, d)) for a, b, c, d in rows)


def _failing(model: MultiPatch, certificate: Certificate) -> list[Point]:
    """Where a map is not proved: its boundary meets itself, or cells are folded or undecided."""
    if certificate.injective:
        return []
    cells = [model.patches[cell.patch](*cell.point) for cell in certificate.cells if cell.kind != "degenerate"]
    return _meetings(model.boundary()) + [(float(x), float(y)) for x, y in cells]


def _meetings(boundary: Boundary) -> list[Point]:
    """Where a boundary crosses or touches itself."""
    return [meeting.point for meeting in check_boundary([list(loop) for loop in boundary.loops]).crossings]


def _farthest(boundary: Boundary, target: Boundary) -> tuple[float, Point]:
    """How far the target's joints and middles of curves are from the boundary, and the farthest of them."""
    curves = [curve for loop in target.loops for curve in loop]
    at = np.concatenate([curve(np.linspace(*curve.domain, 3)[:-1]) for curve in curves])
    away = np.min([Outline(loop).nearest(at)[1] for loop in boundary.loops], axis=0)
    x, y = at[int(away.argmax())].tolist()
    return float(away.max()), (x, y)


def _nearest(outlines: list[Outline], point: Point) -> Point:
    at = np.array([point])
    found: Callable[[Outline], tuple[FloatArray, FloatArray]] = lambda outline: outline.nearest(at)  # noqa: E731
    best = min(outlines, key=lambda outline: float(found(outline)[1][0]))
    x, y = best.point(found(best)[0])[0].tolist()
    return x, y
