"""Morph: certified multi-patches in between two of the same topology.

Three ways, the first that is certified on all frames: control points interpolated after the best similarity is taken
off; control points blended as rigidly as possible, so that limbs turn instead of shrinking; the boundary of that
blend, filled anew by one `TransferPlan`. A way is taken for all frames where possible, because a change of way is a
jump; frames on which it fails take the next one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from ..errors import InputError, TransferError
from ..geometry.conformity.coincidences import between_parts
from ..geometry.multipatch import MultiPatch
from ..geometry.topology import Topology
from ..mesh.background_mesh import TriangleMesh, source_mesh
from ..numeric.arrays import FloatArray
from ..pipeline.plan import TransferPlan
from ..pipeline.result import NotCertifiedError
from ..proof.certificate import Certificate
from ..proof.source_corners import certify_straight
from .rigid_blend import RigidBlend, Similarity

__all__ = ["Morph", "MorphFrame", "check_same_topology", "morph"]

#: Knots of a and b agree when they differ by less than this part of their range.
KNOT_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class MorphFrame:
    """One step of a morph.

    Attributes
    ----------
    t : float
        0 at a, 1 at b.
    multipatch : MultiPatch
    certificate : Certificate
    way : str
        "given" (a and b themselves), "interpolated", "rigid" or "filled"; see `morph`.
    """

    t: float
    multipatch: MultiPatch
    certificate: Certificate
    way: str

    def __repr__(self) -> str:
        return f"<MorphFrame: t = {self.t:g}, {self.way}, {self.certificate.status}>"

    def to_dict(self) -> dict[str, Any]:
        """Everything but the geometry, ready for JSON."""
        return {"t": self.t, "way": self.way, "certificate": self.certificate.to_dict()}


@dataclass(frozen=True, eq=False)
class Morph(Sequence[MultiPatch]):
    """A sequence of multi-patches from a to b with a certificate for each.

    Attributes
    ----------
    frames : tuple of MorphFrame
    """

    frames: tuple[MorphFrame, ...]

    @property
    def certified(self) -> bool:
        """Whether every frame is proved injective."""
        return all(frame.certificate.injective for frame in self.frames)

    def __len__(self) -> int:
        return len(self.frames)

    @overload
    def __getitem__(self, index: int) -> MultiPatch: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[MultiPatch, ...]: ...
    def __getitem__(self, index: int | slice) -> MultiPatch | tuple[MultiPatch, ...]:
        if isinstance(index, slice):
            return tuple(frame.multipatch for frame in self.frames[index])
        return self.frames[index].multipatch

    def __iter__(self) -> Iterator[MultiPatch]:
        return (frame.multipatch for frame in self.frames)

    def __repr__(self) -> str:
        good = sum(frame.certificate.injective for frame in self.frames)
        ways = sorted({frame.way for frame in self.frames[1:-1]})
        return f"<Morph: {good} of {len(self)} frames certified, {', '.join(ways) or 'ends only'}>"


def morph(
    a: MultiPatch,
    b: MultiPatch,
    n: int = 30,
    *,
    way: str = "auto",
    continuity: str | None = None,
    on_failure: str = "raise",
    progress: Callable[[int, int], None] | None = None,
) -> Morph:
    """Multi-patches in between two of the same topology, degrees and knots, certified at every step.

    Parameters
    ----------
    a, b : MultiPatch
        For example a source and its transfer, or two transfers of one source. Injective.
    n : int, default 30
        Number of frames with both ends, at least 2; t is uniform.
    way : {"auto", "rigid"}, default "auto"
        "rigid" leaves the interpolation out: limbs that turn far keep their size, and distortion stays lower.
    continuity : str, optional
        Of frames that are filled anew, as in `transfer`; default as there. The other ways blend the rows that both
        ends satisfy only approximately.
    on_failure : {"raise", "return"}, default "raise"
        What to do when a frame is not certified.
    progress : callable, optional
        Called as ``progress(frames_done, n)``.

    Returns
    -------
    Morph
        Frame by frame the multi-patch, its certificate and the way it was made: "given" at the ends; "interpolated",
        the best similarity of a and b taken to the fraction t (its rotation as a rotation) and what is left
        interpolated linearly; "rigid", what is left blended as rigidly as possible from both ends; "filled", the
        boundary of that with a new interior.

    Raises
    ------
    InputError
        When a and b do not have the same patches, degrees, knots, weights and interfaces, or one is not injective.
    NotCertifiedError
        When a frame is not certified and `on_failure` is "raise"; the message names the frame.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> result = pt.transfer(source, target, landmarks)
    >>> frames = pt.morph(source, result.multipatch, 5).frames
    >>> [frame.t for frame in frames], all(frame.certificate.injective for frame in frames)
    ([0.0, 0.25, 0.5, 0.75, 1.0], True)
    """
    if n < 2:
        raise InputError(f"a morph needs at least 2 frames, its ends; got n = {n}")
    if way not in ("auto", "rigid"):
        raise InputError(f"way must be one of auto, rigid, got {way!r}")
    if on_failure not in ("raise", "return"):
        raise InputError(f"on_failure must be one of raise, return, got {on_failure!r}")
    check_same_topology(a, b)
    times = np.linspace(0, 1, n).tolist()
    blend = _Blend(a, b)
    frames: dict[int, MorphFrame] = {}
    for index, name, model in ((0, "first", a), (n - 1, "second", b)):
        model, certificate, _ = certify_straight(model)
        if not certificate.injective:
            raise InputError(f"the {name} model is not injective: {'; '.join(certificate.reasons[:3])}")
        frames[index] = MorphFrame(times[index], model, certificate, "given")
    plan = _Lazy(lambda: TransferPlan(a) if continuity is None else TransferPlan(a, continuity))
    inner = range(1, n - 1)
    linear = {i: _frame(a, blend.interpolated(times[i]), times[i], "interpolated") for i in inner}
    if way == "auto" and all(frame.certificate.injective for frame in linear.values()):
        frames |= linear
    else:
        for i in inner:
            frames[i] = _turning_frame(a, blend.rigid(times[i]), times[i], plan, linear[i])
            if progress is not None:
                progress(i, n)
    if progress is not None:
        progress(n, n)
    result = Morph(tuple(frames[i] for i in range(n)))
    if on_failure == "raise" and not result.certified:
        i, bad = next((i, f) for i, f in enumerate(result.frames) if not f.certificate.injective)
        raise NotCertifiedError(
            f"frame {i} of {n} (t = {bad.t:.3g}) is not certified: {'; '.join(bad.certificate.reasons[:3])}; morph "
            "through a shape in between, or take on_failure='return'"
        )
    return result


def check_same_topology(a: MultiPatch, b: MultiPatch) -> None:
    """Raise `InputError` unless two multi-patches differ in their control points only; the message says where."""
    if len(a) != len(b):
        raise InputError(f"morph: the models have {len(a)} and {len(b)} patches; use two transfers of one source")
    for k, (p, q) in enumerate(zip(a.patches, b.patches, strict=True)):
        if p.degrees != q.degrees or p.shape != q.shape:
            raise InputError(
                f"morph: patch {k} has degrees {p.degrees} and {p.shape} control points in the first model, "
                f"{q.degrees} and {q.shape} in the second; use two transfers of one source"
            )
        for name, first, second in zip("uv", p.knots, q.knots, strict=True):
            if np.abs(first - second).max() > KNOT_TOLERANCE * np.ptp(first):
                raise InputError(f"morph: the knots of patch {k} in {name} differ; use two transfers of one source")
        if (p.weights is None) != (q.weights is None) or not (
            p.weights is None or q.weights is None or np.array_equal(p.weights, q.weights)
        ):
            raise InputError(f"morph: the weights of patch {k} differ; use two transfers of one source")
    if _glue(a) != _glue(b):
        raise InputError("morph: patches are glued differently; use two transfers of one source")
    if (a.topology.orientation != b.topology.orientation).any():
        k = int(np.argmax(a.topology.orientation != b.topology.orientation))
        raise InputError(f"morph: patch {k} is left-handed in one model and right-handed in the other: mirrored")


def _glue(mp: MultiPatch) -> set[frozenset[tuple[int, int]] | tuple[object, ...]]:
    return {(frozenset([(f.patch_a, int(f.side_a)), (f.patch_b, int(f.side_b))]), f.reversed) for f in mp.interfaces}


def _frame(a: MultiPatch, points: FloatArray, t: float, way: str) -> MorphFrame:
    model, certificate, _ = certify_straight(a.with_shared_points(points))
    return MorphFrame(t, model, certificate, way)


def _turning_frame(a: MultiPatch, points: FloatArray, t: float, plan: _Lazy, last: MorphFrame) -> MorphFrame:
    """The rigid blend; where it is not certified its boundary filled anew, then `last`."""
    frame = _frame(a, points, t, "rigid")
    if frame.certificate.injective:
        return frame
    filled = _filled(plan, points, t)
    return next((f for f in (filled, last) if f is not None and f.certificate.injective), filled or frame)


def _filled(plan: _Lazy, points: FloatArray, t: float) -> MorphFrame | None:
    try:
        found = plan.get().refill(points)
    except TransferError:
        # An infeasible boundary has no certified filling: the blend keeps its own failed certificate.
        return None
    return MorphFrame(t, found.multipatch, found.certificate, "filled")


class _Lazy:
    """A plan made when it is first needed."""

    def __init__(self, make: Callable[[], TransferPlan]) -> None:
        self._make = make
        self._plan: TransferPlan | None = None

    def get(self) -> TransferPlan:
        if self._plan is None:
            self._plan = self._make()
        return self._plan


class _Blend:
    """Shared control points in between, by both ways."""

    def __init__(self, a: MultiPatch, b: MultiPatch) -> None:
        self._a, self._b = a.topology, _numbered_as(a.topology, b)
        self._x, self._y = self._a.coordinates, self._b
        self._similarity = Similarity(self._x, self._y)
        self._rest = self._similarity.undo(self._y)
        self._rigid: tuple[RigidBlend, RigidBlend] | None = None
        self._models = a, b

    def interpolated(self, t: float) -> FloatArray:
        return self._similarity.apply((1 - t) * self._x + t * self._rest, t)

    def rigid(self, t: float) -> FloatArray:
        if self._rigid is None:
            if self._a.n_components != 1:
                why = between_parts(self._a.patches, self._a.interfaces)
                parts = f"{self._a.n_components} separate parts"
                raise InputError(f"the models cannot be blended rigidly, for they have {parts}{why}")
            forth, _ = source_mesh(self._a)
            moved = self._models[0].with_shared_points(self._rest)
            back, _ = source_mesh(moved.topology)
            self._rigid = RigidBlend(_whole(forth), self._rest), RigidBlend(_whole(back), self._x)
        forth_blend, back_blend = self._rigid
        blended = (1 - t) * forth_blend.at(t) + t * back_blend.at(1 - t)
        return self._similarity.apply(blended, t)


def _numbered_as(topology: Topology, other: MultiPatch) -> FloatArray:
    """Shared control points of another model in this one's numbering."""
    points = np.empty((topology.n_points, 2))
    for index, patch in zip(topology.points, other.patches, strict=True):
        points[index] = patch.control_points
    return points


def _whole(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh, if every vertex belongs to a triangle."""
    if len(np.unique(mesh.triangles)) != len(mesh.points):
        raise InputError("morph: a control point belongs to no triangle of the control net; refine the models")
    return mesh
