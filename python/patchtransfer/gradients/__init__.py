"""Certified maps as differentiable functions of their boundary: `Frozen` and what it gives."""

from .filled import Filled
from .frozen import Frozen, freeze
from .inner_product import InnerProduct
from .outline_map import OutlineMap

__all__ = ["Filled", "Frozen", "InnerProduct", "OutlineMap", "freeze"]
