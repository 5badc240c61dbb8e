"""Rational (NURBS) models made polynomial."""

from __future__ import annotations

from .polynomial import Converted, to_polynomial

__all__ = ["Converted", "to_polynomial"]
