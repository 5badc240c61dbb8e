"""A known solution of Poisson's equation: the paper's, in waves as long as suit the model."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..numeric.arrays import FloatArray

__all__ = ["Wave"]


@dataclass(frozen=True)
class Wave:
    """u = sin(πx/L) sin(πy/L), the paper's solution for L = 1, whose half waves have the length L.

    Examples
    --------
    >>> Wave.of_size(2.4), Wave.of_size(92.0), Wave.of_size(0.09)
    (Wave(length=1.0), Wave(length=100.0), Wave(length=0.1))
    """

    length: float = 1.0

    @classmethod
    def of_size(cls, diameter: float) -> Wave:
        """For a model of this diameter: a power of ten, so that it can be said in words."""
        return cls(10.0 ** round(math.log10(diameter / 2)))

    def __call__(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Its values."""
        k = np.pi / self.length
        return np.asarray(np.sin(k * x) * np.sin(k * y))

    def gradient(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Its gradient."""
        k = np.pi / self.length
        return k * np.cos(k * x) * np.sin(k * y), k * np.sin(k * x) * np.cos(k * y)

    def load(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Right-hand side 2 (π/L)² u, of the paper for L = 1."""
        return np.asarray(2 * (np.pi / self.length) ** 2 * self(x, y))

    def __str__(self) -> str:
        if self.length == 1:
            return "sin(πx) sin(πy)"
        return f"sin(πx/{self.length:g}) sin(πy/{self.length:g})"
