"""Pairs of real drawings of the same kind of thing, family by family."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import patchtransfer as pt

# Last, for outlines of other names lie in tests/support.
sys.path.append(str(Path(__file__).parents[2] / "scripts"))
from curves import mirrored, naca, rectangle
from glyphs import glyph
from icons import ICONS


@dataclass(frozen=True)
class Drawing:
    """An outline with its name, which tells it from all others."""

    name: str
    boundary: pt.Boundary


@dataclass(frozen=True)
class Pair:
    """Two drawings of the same thing."""

    family: str
    name: str
    first: Drawing
    second: Drawing


SANS, SERIF, MONO, STIX = "DejaVuSans", "DejaVuSerif", "DejaVuSansMono", "STIXGeneral"
#: Glyphs by family: two fonts that ship with matplotlib, and the characters that are drawn in both.
GLYPHS: dict[str, list[tuple[str, str, str]]] = {
    "regular to bold": [
        (SANS, f"{SANS}-Bold", "ARk5ays"),
        (SERIF, f"{SERIF}-Bold", "EhnR2"),
        (STIX, "STIXGeneralBol", "mTD"),
        ("cmr10", "cmb10", "kP"),
    ],
    "regular to oblique": [(SANS, f"{SANS}-Oblique", "BgtK7"), (MONO, f"{MONO}-Oblique", "eWr3")],
    "two sans": [(SANS, "cmss10", "yRSGtPdF2M94")],
    "two serif": [("cmr10", STIX, "HnU"), (SERIF, "cmr10", "0bL"), (SERIF, STIX, "TuE")],
    "serif and sans": [
        (STIX, SANS, "AKVnh1"),
        ("cmr10", "cmss10", "CkXuD4"),
        (SERIF, SANS, "5gEmTPr7"),
    ],
    "proportional and mono": [(SANS, MONO, "wMl3r"), ("cmss10", MONO, "fJu"), ("cmr10", "cmtt10", "SxI")],
}
#: Airfoils of four digits, in a box.
AIRFOILS = [
    ("0024", "0012"), ("0012", "0006"), ("0012", "2412"), ("2412", "4412"),
    ("4412", "6409"), ("4415", "2309"), ("0018", "6412"), ("1408", "6415"),
]  # fmt: skip
#: Files under PATCHTRANSFER_MODELS.
MODELS = [
    ("real/gismo/amoeba0_pdomain", "real/gismo/austria0_pdomain"),
    ("real/gismo/amoeba1_pdomain", "real/gismo/ellipse_hole_pd"),
    ("real/gismo/amoeba2_pdomain", "real/gismo/mask_pd"),
    ("real/gismo/planarDomainPuzzle1", "real/gismo/planarDomainPuzzle2"),
    ("real/gismo/planarDomainPuzzle1", "real/gismo/planaDomainPuzzleMod2"),
    ("real/gismo/heart2p", "disc"),
]
#: Drawings of which one is a mirror image: kind and variants of icons, character and fonts of glyphs.
MIRRORED_ICONS = [("key", 0, 1), ("key", 2, 0), ("puzzle", 0, 1), ("house", 3, 2)]
MIRRORED_GLYPHS = [("J", SANS, "cmss10"), ("R", SANS, f"{SANS}-Bold")]


def _letter(character: str, font: str) -> Drawing:
    outline = glyph(character, font)
    assert outline is not None, f"{character} of {font} has several components"
    return Drawing(f"{character} {font}", outline)


def _icon(kind: str, variant: int) -> Drawing:
    return Drawing(f"{kind} {variant}", pt.Boundary(ICONS[kind][variant]))


def _airfoil(digits: str) -> Drawing:
    return Drawing(f"NACA {digits}", pt.Boundary([rectangle(4, 2), naca(digits)]))


def _mirror_image(drawing: Drawing) -> Drawing:
    loops = mirrored([list(loop) for loop in drawing.boundary.loops])
    return Drawing(f"{drawing.name} mirrored", pt.Boundary(loops))


def _glyph_pairs(family: str) -> Iterator[Pair]:
    # In turn, so that the first few have something of every two fonts.
    fonts = GLYPHS[family]
    for k in range(max(len(characters) for *_, characters in fonts)):
        for first, second, characters in fonts:
            if k < len(characters):
                character = characters[k]
                yield Pair(family, character, _letter(character, first), _letter(character, second))


def _icon_pairs() -> Iterator[Pair]:
    for k in range(max(map(len, ICONS.values())) - 1):
        for kind, variants in ICONS.items():
            if k + 1 < len(variants):
                yield Pair("icons", kind, _icon(kind, k), _icon(kind, k + 1))


def _mirrored_pairs() -> Iterator[Pair]:
    for kind, a, b in MIRRORED_ICONS:
        yield Pair("mirrored", kind, _icon(kind, a), _mirror_image(_icon(kind, b)))
    for character, first, second in MIRRORED_GLYPHS:
        yield Pair("mirrored", character, _letter(character, first), _mirror_image(_letter(character, second)))


def _model(name: str) -> Drawing:
    with warnings.catch_warnings():
        # What readers say of the files is not the matter here.
        warnings.simplefilter("ignore", pt.InputWarning)
        boundary = pt.read_boundary(Path(os.environ["PATCHTRANSFER_MODELS"]) / f"{name}.xml")
    return Drawing(Path(name).name, boundary)


def _model_pairs() -> Iterator[Pair]:
    folder = os.environ.get("PATCHTRANSFER_MODELS")
    for names in MODELS if folder else []:
        if all((Path(str(folder)) / f"{name}.xml").exists() for name in names):
            yield Pair("models", "", *map(_model, names))


def _airfoil_pairs() -> Iterator[Pair]:
    for a, b in AIRFOILS:
        yield Pair("airfoils", "NACA", _airfoil(a), _airfoil(b))


#: All families, in the order of the table.
FAMILIES = (*GLYPHS, "airfoils", "icons", "mirrored", "models")


def pairs(family: str) -> list[Pair]:
    """All pairs of a family; models only where PATCHTRANSFER_MODELS has them."""
    own = {"airfoils": _airfoil_pairs, "icons": _icon_pairs, "mirrored": _mirrored_pairs, "models": _model_pairs}
    return list(own[family]() if family in own else _glyph_pairs(family))
