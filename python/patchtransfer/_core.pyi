from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

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

class TriangulationError(ValueError):
    args: tuple[str, str, list[int]]

def triangulate(
    points: FloatArray,
    loops: Sequence[IntArray],
    min_angle: float | None = None,
    max_area: float | None = None,
) -> tuple[FloatArray, IntArray]: ...
def cotan_laplacian(
    points: FloatArray, triangles: IntArray
) -> tuple[FloatArray, IntArray, IntArray, tuple[int, int]]: ...
def project_bounded_distortion(jacobians: FloatArray, k: FloatArray) -> FloatArray: ...

class LocalGlobal:
    def __init__(
        self,
        points: FloatArray,
        triangles: IntArray,
        fixed: IntArray,
        null_space: tuple[FloatArray, IntArray, IntArray, tuple[int, int]] | None = None,
    ) -> None: ...
    def harmonic(self, u: FloatArray) -> FloatArray: ...
    def iterate(
        self, u: FloatArray, k: FloatArray, iterations: int, tolerance: float
    ) -> tuple[FloatArray, list[int], list[float]]: ...
    def singular_values(self, u: FloatArray) -> FloatArray: ...
    def flips(self, u: FloatArray) -> int: ...

def evaluate_outline(pieces: FloatArray, table: FloatArray, s: FloatArray, from_left: bool) -> FloatArray: ...
def outline_feet(
    pieces: FloatArray, table: FloatArray, points: FloatArray, s: FloatArray, reach: FloatArray
) -> FloatArray: ...
def inner_distances(points: FloatArray, sizes: list[int]) -> FloatArray: ...

class Matching:
    def __init__(
        self,
        source: FloatArray,
        target: FloatArray,
        cost: FloatArray,
        point_cost: FloatArray,
        source_skip: FloatArray,
        target_skip: FloatArray,
        stretch: float,
        band: float,
    ) -> None: ...
    def scan(self, starts: list[int]) -> FloatArray: ...
    def solve(self, start: int) -> tuple[float, IntArray] | None: ...

def set_threads(n: int) -> None: ...

class SplineOptimizer:
    def __init__(
        self,
        reference: list[tuple[FloatArray, FloatArray, int, int, FloatArray, FloatArray | None]],
        indices: list[NDArray[np.int64]],
        n_points: int,
        free: list[int],
        nodes_per_degree: int = 2,
        extra: list[tuple[int, float, float]] = ...,
        excluded: list[tuple[int, int]] = ...,
        z: tuple[NDArray[np.int64], NDArray[np.int64], FloatArray, int] | None = None,
    ) -> None: ...
    def harmonic(self, points: FloatArray) -> FloatArray: ...
    def determinants(self, points: FloatArray) -> tuple[float, float]: ...
    def minimise(
        self,
        points: FloatArray,
        lambda_: float = 0.3,
        max_steps: int = 200,
        tolerance: float = 1e-8,
        callback: Callable[[int, float, float], None] | None = None,
    ) -> tuple[FloatArray, float, float, FloatArray, str]: ...
