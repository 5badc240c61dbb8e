"""How messages name the command that makes a model conform, and lengths."""

from __future__ import annotations

from decimal import ROUND_CEILING, Context, Decimal
from math import inf

__all__ = ["OTHER_CURVE", "conform_command", "enough", "gap_in_words", "short"]

#: What to do where no refinement helps.
OTHER_CURVE = "make one of the patches again from the other's curve"
#: Below, zeros would have to be counted.
SMALL = 1e-3
#: Bits of a decimal number, and of a difference of coordinates, that do not make the next larger digit.
LAST_BITS = 1e-9


def conform_command(gap: float) -> str:
    """The command that closes gaps of this size."""
    return f"patchtransfer refine --conform{f' --weld {enough(gap)}' if gap > 0 else ''}"


def gap_in_words(gap: float) -> str:
    """What an interface's sides are apart, and the mend."""
    if gap == inf:
        return f"the weights of the two sides differ; {OTHER_CURVE}"
    return f"the sides are {short(gap)} apart; run `{conform_command(gap)}`"


def enough(gap: float) -> str:
    """The gap in two digits, rounded up but for the last bits of a decimal number."""
    return short(float(Context(prec=2, rounding=ROUND_CEILING).create_decimal(Decimal(gap * (1 - LAST_BITS)))))


def short(x: float) -> str:
    """Three digits; small numbers with an exponent without leading zeros."""
    if not 0 < abs(x) < SMALL:
        return f"{x:.3g}"
    mantissa, exponent = f"{x:.2e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
