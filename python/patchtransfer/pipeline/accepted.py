"""What a source has to be before anything is made of it."""

from __future__ import annotations

from ..continuity.g1 import check_g1_space
from ..errors import InputError
from ..geometry.conformity.coincidences import between_parts
from ..geometry.multipatch import MultiPatch
from ..interior.solver import CONTINUITY
from ..proof.source_corners import certify_straight
from .options import CHOICES

__all__ = ["accepted", "check_polynomial"]


def check_polynomial(source: MultiPatch, what: str) -> None:
    """Raise `InputError` on a rational source, for something that takes no weights."""
    rational = [k for k, patch in enumerate(source.patches) if patch.weights is not None]
    if rational:
        raise InputError(
            f"patch {rational[0]} of the source is rational (NURBS), and {what} takes polynomial B-splines only; "
            "convert it first: MultiPatch.to_polynomial, or --polynomial 1e-6 of `patchtransfer transfer` and `convert`"
        )


def accepted(source: MultiPatch, continuity: str, ratios: str) -> tuple[MultiPatch, list[str]]:
    """The source with shared points, certified injective, and notes on straight corners that were put straight.

    Raises
    ------
    InputError
        On a source that cannot be transferred: no multi-patch, disconnected, folded (naming the patch), or for "g1"
        rational or without the freedom that it needs; on another continuity than "c0", "c1" and "g1", on other ratios.
    """
    if not isinstance(source, MultiPatch):
        raise InputError(f"source must be a MultiPatch (see read), got {type(source).__name__}")
    if continuity not in CONTINUITY:
        raise InputError(f"continuity must be one of {', '.join(CONTINUITY)}, got {continuity!r}")
    if ratios not in CHOICES["ratios"]:
        raise InputError(f"ratios must be one of {', '.join(CHOICES['ratios'])}, got {ratios!r}")
    if (continuity, ratios) == ("g1", "source"):
        raise InputError('ratios="source" is for continuity="c1": gluing data of the source fit no exact G1 map')
    if continuity == "g1":
        check_polynomial(source, 'continuity="g1"')
        check_g1_space(source)
    topology = source.topology
    if topology.n_components != 1:
        why = between_parts(source.patches, source.interfaces)
        raise InputError(f"the source has {topology.n_components} separate parts{why}")
    welded, certificate, notes = certify_straight(source.with_shared_points(topology.coordinates))
    if not certificate.injective:
        raise InputError(f"the source is not an injective parameterization: {'; '.join(certificate.reasons)}")
    return welded, notes
