import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

__version__: str

PatchTuple = tuple[FloatArray, FloatArray, int, int, FloatArray, FloatArray | None]
CurveTuple = tuple[FloatArray, int, FloatArray, FloatArray | None]
CellTuple = tuple[str, tuple[float, float, float, float], tuple[float, float], float]
PlaceTuple = tuple[int, int, float]
MeetingTuple = tuple[str, PlaceTuple, PlaceTuple, tuple[float, float]]

def certify_patches(
    patches: list[PatchTuple], signs: list[float], max_depth: int
) -> list[tuple[float, bool, int, list[CellTuple]]]: ...
def certify_loops(
    loops: list[list[CurveTuple]],
) -> tuple[list[MeetingTuple], list[int], list[list[int] | None], float, int]: ...
def bezier_extract(knots: FloatArray, degree: int, coefficients: FloatArray) -> FloatArray: ...
