"""Numbers of G+Smo XML: whole ones, decimals, fractions, base64; each with the place in the message."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from ...errors import InputError
from ...limits import TOO_LARGE, first_unusable
from ...numeric.arrays import FloatArray

__all__ = ["attribute", "counted", "integer", "integers", "numbers"]

BINARY = {
    f"b64{kind}{bits}": np.dtype(f"<{kind[0]}{bits // 8}")
    for kind, sizes in (("float", (32, 64)), ("int", (16, 32, 64)), ("uint", (16, 32, 64)))
    for bits in sizes
}


#: Digits and signs of whole numbers: longer ones name nothing and do not fit into 64 bits.
MAX_DIGITS = 18


def attribute(element: Element, name: str, where: str) -> str:
    """An attribute that must be there, without blanks around it."""
    value = element.get(name)
    if value is None:
        raise InputError(f"{where}: <{element.tag}> has no attribute {name}; add it")
    return value.strip()


def integer(text: str, where: str) -> int:
    """A whole number."""
    try:
        value = int(text) if len(text) <= MAX_DIGITS else None
    except ValueError:
        value = None
    if value is None:
        raise InputError(f"{where}: {text[:30]!r} is not a whole number; correct it")
    return value


def integers(element: Element | None, where: str) -> list[int]:
    """All whole numbers of an element, none if there is no element."""
    return [] if element is None else [integer(token, where) for token in "".join(element.itertext()).split()]


def _number(token: str) -> float:
    """Return the value of a decimal or of a fraction such as 2/5."""
    if "_" in token:
        raise ValueError
    above, slash, below = token.partition("/")
    return float(above) / float(below) if slash else float(above)


def numbers(element: Element, where: str) -> FloatArray:
    """All numbers of an element, written as text or in base64."""
    text = "".join(element.itertext())
    flag = element.get("format", "ascii").strip().lower()
    if flag != "ascii":
        if flag not in BINARY:
            raise InputError(f"{where}: unknown number format {flag!r} of <{element.tag}>; write it as ASCII")
        try:
            values = np.frombuffer(base64.b64decode(text), BINARY[flag]).astype(np.float64)
        except (ValueError, binascii.Error) as error:
            raise InputError(f"{where}: <{element.tag}> is not valid base64 ({error}); write it again") from None
        return _bounded(values, element, where)
    tokens = text.split()
    for convert in (float, _number) if "_" not in text else (_number,):
        try:
            values = np.array([convert(t) for t in tokens], dtype=np.float64)
        except (ValueError, ZeroDivisionError):
            continue
        break
    else:
        bad = next(t for t in tokens if not _is_number(t))
        raise InputError(f"{where}: {bad[:30]!r} in <{element.tag}> is not a number; correct it")
    return _bounded(values, element, where)


def _bounded(values: FloatArray, element: Element, where: str) -> FloatArray:
    if (wrong := first_unusable(values)) is not None:
        bad = f"number {wrong + 1} ({values[wrong]:g})"
        raise InputError(f"{where}: {bad} in <{element.tag}> is NaN, infinite or {TOO_LARGE}; correct it")
    return values


def _is_number(token: str) -> bool:
    try:
        _number(token)
    except (ValueError, ZeroDivisionError):
        return False
    return True


def counted(element: Element | None, tag: str, shape: Sequence[int], where: str) -> FloatArray:
    """Numbers of an element that must be there, exactly as many as the shape has."""
    if element is None:
        raise InputError(f"{where}: <{tag}> is missing; the file is incomplete")
    values = numbers(element, where)
    expected = int(np.prod(shape))
    if len(values) != expected:
        raise InputError(
            f"{where}: <{tag}> has {len(values)} numbers, its knots and degrees need {expected} "
            f"({' x '.join(map(str, shape))}); numbers are missing or surplus"
        )
    return values.reshape(shape)
