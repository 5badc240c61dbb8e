import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

__version__: str

def bezier_extract(knots: FloatArray, degree: int, coefficients: FloatArray) -> FloatArray: ...
