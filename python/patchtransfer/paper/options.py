"""Options of the published method, once: what the paper leaves open, and where this package departs from its text.

Free of numerics, so that programs which only read options stay quick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ..errors import InputError

__all__ = ["BOUNDARY_SAMPLES", "INITIAL_MAPS", "PaperOptions"]

INITIAL_MAPS = ("reversible", "dirichlet")
BOUNDARY_SAMPLES = ("source", "uniform")


@dataclass(frozen=True, repr=False)
class PaperOptions:
    """Choices of ``method="paper"``: Xu, Xiao, Xu, Gu, CMES 137(2), 2023.

    The most literal reading is ``PaperOptions(freeze_interfaces=True, literal_rows=True, snap_corners=False,
    boundary_samples="uniform", boundary_weight=1.0)``. See ``docs/methods.md`` for what comes of it.

    Parameters
    ----------
    initial : {"reversible", "dirichlet"}, default "reversible"
        First map. "reversible" is the paper's (§3.3.3, "similar to the reversible harmonic map"); "dirichlet" is the
        single solve of Eq. 8-9 with exact boundary values, which the former tends to.
    freeze_interfaces : bool, default False
        In the last stage (end of §3.3.3) keep interface points, and those in continuity rows, where they are, as the
        paper does, instead of keeping the rows. Less distortion is removed then.
    max_iterations : int, default 2000
        Local-global steps of bounded distortion (Eq. 18) at most, "the specified number of iterations".
    literal_rows : bool, default False
        Continuity rows as Eq. 10 prints them, 2 s - p - q = 0, with equal ratios everywhere; default those weighted by
        knot spans, degrees and the speeds of the map without rows, which are C1 as well. Rows at extraordinary vertices
        (Eq. 11-12) follow frames in any case.
    snap_corners : bool, default True
        Whether source corners that proportions of arc length (§3.2) put next to a target's corner are moved onto it.
        The paper does not say so; without, corners are cut where lengths are not known exactly.
    boundary_weight : float, optional
        λ of the boundary's energy E_b in the first map (§3.3.3), which the paper leaves open; the boundary is made
        exact after it, as A u = b asks (Eq. 16). Default None: exact from the start, the limit of large λ. With any
        finite λ the Dirichlet energy draws the boundary inwards, and identities and affine maps come out only as well
        as the later stages mend that.
    boundary_samples : {"source", "uniform"}, default "source"
        Where the samples q_k of the boundary fit (Eq. 3) are on the target, at uniform parameters t_k: at the
        "proportion and position" (§3.2) that the source's own points at t_k have, or at equal distances. With the
        latter a source is not fitted to itself where its curves' speeds vary.

    Raises
    ------
    InputError
        On values that an option cannot have.

    Examples
    --------
    >>> from patchtransfer import PaperOptions
    >>> PaperOptions(initial="dirichlet", literal_rows=True)
    PaperOptions(initial='dirichlet', literal_rows=True)
    """

    initial: str = "reversible"
    freeze_interfaces: bool = False
    max_iterations: int = 2000
    literal_rows: bool = False
    snap_corners: bool = True
    boundary_weight: float | None = None
    boundary_samples: str = "source"

    def __post_init__(self) -> None:
        if self.initial not in INITIAL_MAPS:
            raise InputError(f"initial must be one of {', '.join(INITIAL_MAPS)}, got {self.initial!r}")
        if self.boundary_samples not in BOUNDARY_SAMPLES:
            choices = ", ".join(BOUNDARY_SAMPLES)
            raise InputError(f"boundary_samples must be one of {choices}, got {self.boundary_samples!r}")
        for name in ("freeze_interfaces", "literal_rows", "snap_corners"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} must be True or False, got {getattr(self, name)!r}")
        if not isinstance(self.max_iterations, int) or self.max_iterations < 0:
            raise InputError(f"max_iterations must be a whole number, not negative, got {self.max_iterations!r}")
        weight = self.boundary_weight
        # A comparison with NaN is false as well.
        if weight is not None and not (isinstance(weight, int | float) and 0 < weight < math.inf):
            raise InputError(
                f"boundary_weight must be a positive number, or None for an exact boundary, got {weight!r}"
            )

    def __repr__(self) -> str:
        given = [f.name for f in fields(self) if getattr(self, f.name) != f.default]
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in given)})"

    @classmethod
    def parse(cls, text: str) -> PaperOptions:
        """Options from a text like ``initial=dirichlet,literal_rows=true``.

        Raises
        ------
        InputError
            On names and values that there are not.

        Examples
        --------
        >>> from patchtransfer import PaperOptions
        >>> PaperOptions.parse("freeze_interfaces=yes,boundary_weight=2")
        PaperOptions(freeze_interfaces=True, boundary_weight=2.0)
        """
        names = {f.name: type(f.default) for f in fields(cls)}
        given: dict[str, object] = {}
        for part in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = (piece.strip() for piece in part.partition("="))
            if name not in names:
                raise InputError(f"the paper's method has no option {name!r}; its options are {', '.join(names)}")
            if name in given:
                raise InputError(f"the option {name} of the paper's method is given twice")
            given[name] = _value(name, value, names[name])
        return cls(**given)  # type: ignore[arg-type]


def _value(name: str, text: str, kind: type) -> object:
    """What a text means for an option whose default is of a kind; of None's it is a number or "none"."""
    if kind is bool:
        found = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}.get(text.lower())
        if found is None:
            raise InputError(f"{name} must be true or false, got {text!r}")
        return found
    if kind is str or text.lower() == "none":
        return None if kind is not str else text
    try:
        return int(text) if kind is int else float(text)
    except ValueError:
        raise InputError(f"{name} must be a number, got {text!r}") from None
