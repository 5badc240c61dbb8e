"""Regenerate the sample "rabbit": ``python scripts/make_rabbit.py``.

Head and chest of a rabbit, three patches wide, that fork into two ears of two patches each. A vertex of valence 5 lies
at the root of each ear and one of valence 3 below its tip. The target has one ear bent.
"""

from __future__ import annotations

from drawing import Drawing, bend, mirrored, quads, write_sample

#: Right half from the chest to the hollow between the ears; unnamed in the layout: only drawn.
RIGHT = {
    "b1": 0.07 + 0.0j,
    "b0*": 0.215 + 0.0j,
    "shoulder": 0.185 + 0.07j,
    "n0": 0.143 + 0.145j,
    "jaw": 0.166 + 0.21j,
    "k0": 0.205 + 0.31j,
    "temple": 0.192 + 0.405j,
    "f0*": 0.145 + 0.49j,
    "ear out low": 0.185 + 0.59j,
    "eo": 0.225 + 0.70j,
    "ear out": 0.256 + 0.79j,
    "to": 0.268 + 0.88j,
    "tip*": 0.25 + 0.98j,
    "ti": 0.165 + 0.91j,
    "ear in": 0.123 + 0.83j,
    "ei": 0.095 + 0.74j,
    "ear in low": 0.068 + 0.63j,
    "a0": 0.03 + 0.555j,
}
INSIDE = {
    "n1": 0.042 + 0.15j,
    "k1": 0.07 + 0.32j,
    "p0": 0.085 + 0.51j,
    "em": 0.16 + 0.72j,
    "tm": 0.215 + 0.89j,
}
QUADS = quads(
    """
    b1 b0 n0 n1
    n1 n0 k0 k1
    k1 k0 f0 p0
    p0 f0 eo em
    a0 p0 em ei
    em eo to tm
    ei em tm ti
    tm to tip ti
    """,
    """
    b1' b1 n1 n1'
    n1' n1 k1 k1'
    k1' k1 p0 p0'
    p0' p0 a0 a0'
    """,
)
EAR = {"ear out low", "eo", "ear out", "to", "tip", "ti", "ear in", "ei", "ear in low"}
LANDMARKS = {
    "chest right": "b0",
    "neck right": "n0",
    "cheek right": "k0",
    "right ear outer root": "f0",
    "right ear outside": "eo",
    "right ear outside near tip": "to",
    "right ear tip": "tip",
    "right ear inside near tip": "ti",
    "right ear inside": "ei",
    "right ear inner root": "a0",
    "left ear inner root": "a0'",
    "left ear inside": "ei'",
    "left ear tip": "tip'",
    "left ear outside": "eo'",
    "left ear outer root": "f0'",
    "cheek left": "k0'",
    "neck left": "n0'",
    "chest left": "b0'",
}


def articulated(name: str, z: complex) -> complex:
    """The right ear bends outwards at half its length."""
    return bend(z, 0.14 + 0.66j, 0.32 + 0.95j, 0.2, -85) if name.rstrip("*") in EAR else z


if __name__ == "__main__":
    drawing = mirrored(RIGHT)
    bent = {name: articulated(name, z) for name, z in drawing.items()}
    inside = mirrored(INSIDE)
    write_sample("rabbit", "Rabbit with a bent ear", Drawing(drawing), Drawing(bent), inside, QUADS, LANDMARKS, 3)
