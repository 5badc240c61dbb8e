from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

__version__: str

PatchTuple = tuple[FloatArray, FloatArray, int, int, FloatArray, FloatArray | None]
CurveTuple = tuple[FloatArray, int, FloatArray, FloatArray | None]
BoundsTuple = tuple[float, float, tuple[int, float, float] | None]
CellTuple = tuple[str, tuple[float, float, float, float], tuple[float, float], float]
PlaceTuple = tuple[int, int, float]
MeetingTuple = tuple[str, PlaceTuple, PlaceTuple, tuple[float, float]]

def set_threads(n: int) -> None: ...

# numeric

def product(a: FloatArray, b: FloatArray) -> FloatArray: ...
def svd(matrices: FloatArray, full: bool) -> tuple[FloatArray, FloatArray, FloatArray]: ...
def eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]: ...
def solve(matrix: FloatArray, rhs: FloatArray) -> FloatArray: ...
def solve_definite(matrix: FloatArray, rhs: FloatArray) -> FloatArray: ...

class SparseCholesky:
    def __init__(self, offsets: IntArray, rows: IntArray) -> None: ...
    def factorize(self, values: FloatArray) -> None: ...
    def solve(self, rhs: FloatArray) -> FloatArray: ...

def gauss(n: int) -> tuple[FloatArray, FloatArray]: ...
def project_bounded_distortion(jacobians: FloatArray, k: FloatArray) -> FloatArray: ...

# spline

def bezier_extract(knots: FloatArray, degree: int, coefficients: FloatArray) -> FloatArray: ...
def evaluate_spline(
    knots: FloatArray, degree: int, coefficients: FloatArray, at: FloatArray, order: int
) -> FloatArray: ...
def evaluate_tensor(
    knots: tuple[FloatArray, FloatArray],
    degrees: tuple[int, int],
    coefficients: FloatArray,
    u: FloatArray,
    v: FloatArray,
    du: int,
    dv: int,
) -> FloatArray: ...
def measure_quality(
    patches: list[PatchTuple], signs: list[float], samples: int, excluded: list[list[int]]
) -> list[tuple[tuple[float, float, float], tuple[float, float, float], tuple[int, int], tuple[float, float]]]: ...
def sample_patch(tuple: PatchTuple, sign: float, samples: int) -> tuple[FloatArray, FloatArray]: ...

class Galerkin:
    def __init__(
        self,
        patches: list[tuple[FloatArray, FloatArray, int, int, FloatArray, FloatArray, IntArray]],
        n: int,
    ) -> None: ...
    def pattern(self) -> tuple[IntArray, IntArray]: ...
    def assemble(self, kinds: list[tuple[int, int]], coefficients: list[FloatArray]) -> FloatArray: ...

# location

class Locator:
    def __init__(self, patches: list[PatchTuple]) -> None: ...
    def locate(self, points: FloatArray, tolerance: float) -> tuple[IntArray, FloatArray, FloatArray]: ...

# outline

class Outline:
    def __init__(self, curves: list[CurveTuple]) -> None: ...
    @property
    def length(self) -> float: ...
    @property
    def area(self) -> float: ...
    @property
    def diameter(self) -> float: ...
    @property
    def joints(self) -> FloatArray: ...
    @property
    def piece_starts(self) -> FloatArray: ...
    def samples(self) -> tuple[FloatArray, FloatArray]: ...
    def arc_length(self, curve: int, t: FloatArray) -> FloatArray: ...
    def evaluate(self, s: FloatArray, from_left: bool) -> FloatArray: ...
    def turn(self, s: FloatArray) -> FloatArray: ...
    def nearest(self, points: FloatArray) -> FloatArray: ...
    def hausdorff(self, other: Outline) -> float: ...

# proof

#: What coordinates are known to, in units of roundoff of the largest one.
DATA_ULPS: float
#: Largest degree that is certified: products up to it have exact binomials.
MAX_DEGREE: int
#: Largest degrees of polynomial and of rational patches whose quality is enclosed.
MAX_QUALITY_DEGREES: list[int]
#: Largest degrees of two polynomial patches that are compared, and of a pair with a rational one.
MAX_COMPARED_DEGREES: list[int]
#: Gauss points a knot span and direction at which models are compared.
COMPARED_NODES: int

def certify_patches(
    patches: list[PatchTuple], signs: list[float], max_depth: int
) -> list[tuple[float, bool, int, list[CellTuple]]]: ...
def prove_quality(
    patches: list[PatchTuple], signs: list[float], excluded: list[list[int]], size: float, width: float
) -> tuple[BoundsTuple, BoundsTuple, int]: ...
def compare_models(
    first: list[PatchTuple],
    second: list[PatchTuple],
    signs: tuple[list[float], list[float]],
    width: float,
) -> tuple[BoundsTuple, tuple[BoundsTuple, BoundsTuple], int, FloatArray]: ...
def certify_loops(
    loops: list[list[CurveTuple]],
) -> tuple[list[MeetingTuple], list[int], list[list[int] | None], float, int]: ...

# registration

class Matching:
    def __init__(
        self,
        source: FloatArray,
        target: FloatArray,
        point_cost: FloatArray,
        source_skip: FloatArray,
        target_skip: FloatArray,
        stretch: float,
        band: float,
    ) -> None: ...
    def scan(self, cost: FloatArray, starts: list[int]) -> FloatArray: ...
    def solve(self, cost: FloatArray, starts: list[int]) -> tuple[float, IntArray] | None: ...

def inner_distances(points: FloatArray, sizes: list[int]) -> FloatArray: ...
def turning(outline: Outline, s: FloatArray, windows: list[float]) -> FloatArray: ...

class Sliding:
    def __init__(
        self,
        loops: list[tuple[Outline, FloatArray, int, FloatArray, FloatArray, FloatArray, float]],
        distances: FloatArray,
        wanted: FloatArray,
        weight: FloatArray,
        windows: list[float],
        plate: tuple[FloatArray, FloatArray, float, float] | None = None,
    ) -> None: ...
    def model(self, x: FloatArray) -> tuple[float, FloatArray, FloatArray]: ...
    def slide(self, x: FloatArray, held: NDArray[np.bool_]) -> tuple[FloatArray, float]: ...

def bending_matrix(points: FloatArray, slack: float) -> FloatArray: ...

# fitting

class BoundaryFit:
    def __init__(
        self,
        outlines: list[Outline],
        bases: list[FloatArray],
        loops: list[tuple[list[int], FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]],
        joints: list[tuple[int, int]],
        stiffness: tuple[float, float, float],
    ) -> None: ...
    def linearise(self, level: bool) -> None: ...
    def solve(self) -> None: ...
    def hold_ends(self, most: float, back: float) -> None: ...
    def align(self) -> None: ...
    def turn(self, shares: FloatArray, most: float) -> None: ...
    def errors(self, whole: bool) -> FloatArray: ...
    def backwards(self) -> FloatArray: ...
    def control_points(self) -> FloatArray: ...

# mesh

#: Below this ratio of twice its area to its squared longest edge the sign of a triangle's area is rounding.
DEGENERATE_TRIANGLE: float

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
def closest_on_mesh(
    queries: FloatArray, vertices: FloatArray, triangles: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]: ...

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
        self, u: FloatArray, k: FloatArray, iterations: int, tolerance: float, seconds: float | None = None
    ) -> tuple[FloatArray, list[int], list[float]]: ...
    def singular_values(self, u: FloatArray) -> FloatArray: ...
    def flips(self, u: FloatArray) -> int: ...

class DistortionDescent:
    def __init__(
        self,
        points: FloatArray,
        triangles: IntArray,
        fixed: IntArray,
        null_space: tuple[FloatArray, IntArray, IntArray, tuple[int, int]] | None = None,
    ) -> None: ...
    def minimise(
        self, u: FloatArray, max_steps: int, tolerance: float, seconds: float | None = None
    ) -> tuple[FloatArray, list[float], str]: ...
    def energy(self, u: FloatArray) -> float: ...

# layout

class LayoutError(ValueError): ...

def layout_mesh(
    points: FloatArray, loops: Sequence[IntArray], vertices: IntArray, quads: IntArray, max_area: float
) -> tuple[FloatArray, IntArray]: ...
def layout_edges(vertices: int, triangles: IntArray) -> IntArray: ...
def layout_field(
    points: FloatArray,
    triangles: IntArray,
    vertices: IntArray,
    quads: IntArray,
    isometries: Sequence[tuple[IntArray, float, float, bool]],
) -> tuple[FloatArray, IntArray]: ...
def layout_map(
    points: FloatArray, triangles: IntArray, theta: FloatArray, index: IntArray, rounds: int
) -> tuple[FloatArray, IntArray, NDArray[np.bool_], int, float, int]: ...
def layout_t_mesh(
    points: FloatArray,
    triangles: IntArray,
    uv: FloatArray,
    rotation: IntArray,
    index: IntArray,
    next: IntArray,
    loops: IntArray,
    corner: NDArray[np.bool_],
) -> tuple[
    tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray],
    list[tuple[list[int], int, list[float], FloatArray, FloatArray]],
    list[list[IntArray]],
    tuple[IntArray, IntArray],
]: ...

# continuity

CompressedTuple = tuple[IntArray, IntArray, FloatArray, tuple[int, int]]

class CircularRowsError(ValueError): ...

class RowSpace:
    def __init__(
        self,
        matrix: CompressedTuple,
        slave: IntArray,
        interface: IntArray,
        order: IntArray,
        interior: IntArray,
        points: FloatArray,
    ) -> None: ...
    def basis(self) -> CompressedTuple: ...
    def particular(self) -> CompressedTuple: ...
    @property
    def dropped(self) -> IntArray: ...
    @property
    def redundant(self) -> int: ...
    def project(self, points: FloatArray) -> FloatArray: ...
    def residual(self, points: FloatArray) -> float: ...

def nearest_on_rows(
    matrix: CompressedTuple, chosen: IntArray, interior: IntArray, points: FloatArray
) -> FloatArray: ...

# optimizer

class SplineOptimizer:
    def __init__(
        self,
        reference: list[tuple[FloatArray, FloatArray, int, int, FloatArray, FloatArray | None]],
        indices: list[NDArray[np.int64]],
        n_points: int,
        free: list[int],
        nodes_per_degree: int,
        extra: list[tuple[int, float, float]] = ...,
        excluded: list[tuple[int, int]] = ...,
        z: tuple[NDArray[np.int64], NDArray[np.int64], FloatArray, int] | None = None,
    ) -> None: ...
    def set_basis(self, values: FloatArray) -> None: ...
    def harmonic(self, points: FloatArray) -> FloatArray: ...
    def determinants(self, points: FloatArray) -> tuple[float, float]: ...
    def gradient(self, points: FloatArray, lambda_: float) -> tuple[float, FloatArray]: ...
    def linearise(self, points: FloatArray, lambda_: float, exact: bool = True, scale: float | None = None) -> None: ...
    def respond(self, forces: list[FloatArray]) -> list[FloatArray]: ...
    def product(self, directions: list[FloatArray]) -> list[FloatArray]: ...
    def settle(self, corrections: int) -> tuple[FloatArray, float, FloatArray, float, float]: ...
    def look_from(self, points: FloatArray) -> None: ...
    def motions(self, begins: list[FloatArray]) -> tuple[list[FloatArray], FloatArray, FloatArray]: ...
    def minimise(
        self,
        points: FloatArray,
        lambda_: float,
        max_steps: int,
        tolerance: float,
        callback: Callable[[int, float, float], None] | None = None,
        seconds: float | None = None,
        scale: float | None = None,
        power: int = 1,
    ) -> tuple[FloatArray, float, float, FloatArray, str]: ...
