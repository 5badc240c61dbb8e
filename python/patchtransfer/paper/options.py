"""What may be chosen in the published method."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InputError

__all__ = ["INITIAL_MAPS", "PaperOptions"]

INITIAL_MAPS = ("reversible", "dirichlet")


@dataclass(frozen=True)
class PaperOptions:
    """Choices of the published method's mesh stages.

    Parameters
    ----------
    initial : {"reversible", "dirichlet"}, default "reversible"
        First map: the paper's, with the boundary softly bound and made exact after it, or one constrained Dirichlet
        solve with exact boundary. With an exact boundary and images inside the target the former tends to the latter.
    freeze_interfaces : bool, default False
        In the last stage keep interface points and those in continuity rows where they are, as the paper does,
        instead of keeping the rows. Less distortion is removed then.
    max_iterations : int, default 2000
        Local-global steps of bounded distortion at most.

    Raises
    ------
    InputError
        On another first map or a negative number of steps.
    """

    initial: str = "reversible"
    freeze_interfaces: bool = False
    max_iterations: int = 2000

    def __post_init__(self) -> None:
        if self.initial not in INITIAL_MAPS:
            raise InputError(f"initial must be one of {', '.join(INITIAL_MAPS)}, got {self.initial!r}")
        if self.max_iterations < 0:
            raise InputError(f"max_iterations must not be negative, got {self.max_iterations}")
