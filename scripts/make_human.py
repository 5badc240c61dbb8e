"""Regenerate the sample "human": ``python scripts/make_human.py``.

A standing figure. The trunk is three patches wide, the arms two, the legs one. Each shoulder has a vertex of valence 3
and each side of the chest one of valence 5; the head is capped around two more of valence 3. The target raises its arms
and makes a step.
"""

from __future__ import annotations

import cmath

from drawing import Drawing, Points, bend, mirrored, quads, write_sample

ARM_ROOT, ARM_DIRECTION = 0.155 + 0.705j, cmath.exp(-0.6j)
HEAD, HEAD_RADIUS = 0.9j, 0.085


def arm(along: float, across: float) -> complex:
    """Point of the arm's frame."""
    return ARM_ROOT + (along + 1j * across) * ARM_DIRECTION


def head(angle: float) -> complex:
    """Point of the head's circle, degrees."""
    return HEAD + cmath.rect(HEAD_RADIUS, cmath.pi * angle / 180)


#: Right half from the crotch to the top of the head; names that are not in the layout are only drawn.
RIGHT: Points = {
    "c*": 0.018 + 0.425j,
    "leg.thigh in": 0.034 + 0.33j,
    "leg.ki": 0.045 + 0.235j,
    "leg.calf in": 0.05 + 0.12j,
    "leg.fi*": 0.055 + 0.0j,
    "leg.fo*": 0.15 + 0.0j,
    "leg.ankle": 0.127 + 0.06j,
    "leg.calf out": 0.132 + 0.14j,
    "leg.ko": 0.13 + 0.24j,
    "leg.thigh out": 0.143 + 0.35j,
    "ho": 0.142 + 0.45j,
    "waist": 0.112 + 0.55j,
    "arm.a*": arm(0.0, -0.062),
    "arm.low": arm(0.09, -0.047),
    "arm.el": arm(0.185, -0.04),
    "arm.wrist low": arm(0.29, -0.034),
    "arm.hl*": arm(0.37, -0.034),
    "arm.hm": arm(0.385, 0.0),
    "arm.hu*": arm(0.37, 0.034),
    "arm.wrist up": arm(0.29, 0.034),
    "arm.eu": arm(0.185, 0.042),
    "arm.up": arm(0.09, 0.052),
    "arm.s": arm(0.0, 0.058),
    "collar": 0.1 + 0.777j,
    "nl*": 0.04 + 0.79j,
    "throat": 0.039 + 0.812j,
    "cheek": head(-42),
    "h1": head(0),
    "h25": head(25),
    "h2": head(47),
    "h70": head(70),
}
INSIDE: Points = {
    "am": ARM_ROOT,
    "em": arm(0.185, 0.0),
    "mc": 0.045 + 0.655j,
    "p": 0.095 + 0.72j,
    "nc": 0.013 + 0.79j,
    "q0": 0.035 + 0.87j,
    "q3": 0.035 + 0.925j,
}
QUADS = quads(
    """
    leg.ki leg.fi leg.fo leg.ko
    c leg.ki leg.ko ho
    c ho arm.a mc
    mc arm.a am p
    mc p nl nc
    p am arm.s nl
    arm.a arm.el em am
    arm.el arm.hl arm.hm em
    am em arm.eu arm.s
    em arm.hm arm.hu arm.eu
    nc nl h1 q0
    q0 h1 h2 q3
    """,
    """
    c' c mc mc'
    mc' mc nc nc'
    nc' nc q0 q0'
    q0' q0 q3 q3'
    q3' q3 h2 h2'
    """,
)
HALF_LANDMARKS = {
    "crotch": "c",
    "knee inside": "leg.ki",
    "foot inside": "leg.fi",
    "foot outside": "leg.fo",
    "knee outside": "leg.ko",
    "hip": "ho",
    "armpit": "arm.a",
    "elbow below": "arm.el",
    "hand below": "arm.hl",
    "hand tip": "arm.hm",
    "hand above": "arm.hu",
    "elbow above": "arm.eu",
    "shoulder": "arm.s",
    "neck": "nl",
    "ear": "h1",
    "head": "h2",
}
LANDMARKS = {f"right {place}": name for place, name in HALF_LANDMARKS.items()}
LANDMARKS |= {f"left {place}": name + "'" for place, name in reversed(HALF_LANDMARKS.items())}

#: Arm and leg of the right and the left: how far they turn outwards, degrees.
POSE = {"arm": (72, 88), "leg": (32, 14)}


def articulated(name: str, z: complex) -> complex:
    """Raise the arms from the shoulders and put the legs apart from the hips."""
    limb, left = name.partition(".")[0], name.rstrip("*").endswith("'")
    if limb not in POSE:
        return z
    z = -z.conjugate() if left else z
    joint, direction = (arm(-0.04, 0.0), ARM_DIRECTION) if limb == "arm" else (0.085 + 0.43j, -1j)
    z = bend(z, joint, direction, 0.16, POSE[limb][left])
    return -z.conjugate() if left else z


if __name__ == "__main__":
    drawing = mirrored(RIGHT)
    moved = {name: articulated(name, z) for name, z in drawing.items()}
    inside = mirrored(INSIDE)
    write_sample("human", "Figure with raised arms", Drawing(drawing), Drawing(moved), inside, QUADS, LANDMARKS, 3)
