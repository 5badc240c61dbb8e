"""A library chooses by cheap looks at all models and dear ones at few, keeps what it has seen, and says why."""

from __future__ import annotations

import sqlite3

import numpy as np
import pytest

import domains
import models
import patchtransfer as pt
import targets
from failing import folded_source
from patchtransfer.library import entries, library
from patchtransfer.library import models as shelf
from patchtransfer.library.choice import PARAMETERIZE
from patchtransfer.library.index import NAME, key_of


def shapes() -> dict[str, pt.MultiPatch]:
    """A square, bars of three lengths, and a plate with a hole."""
    return {
        "square": models.grid(1, 1, 2, 3),
        "short": models.grid(1, 2, 2, 3),
        "bar": models.grid(1, 4, 2, 3),
        "long": models.grid(1, 8, 2, 3),
        "plate": models.plate_with_hole(2, 3),
    }


@pytest.fixture(scope="module")
def target() -> pt.Boundary:
    """The bar, bent by 50 degrees."""
    bar = shapes()["bar"]
    return targets.deformed(bar, targets.bend(bar, 50))[0]


@pytest.fixture
def folder(tmp_path):
    """The models as files."""
    place = tmp_path / "models"
    place.mkdir()
    for name, model in shapes().items():
        pt.write(model, place / f"{name}.xml")
    return place


# --- the choice -----------------------------------------------------------------------------------


def test_the_shape_itself_comes_first(target):
    ranked = pt.Library(shapes()).rank(target)
    assert ranked[0].name == "bar"
    scores = [c.score for c in ranked if c.score is not None]
    assert scores == sorted(scores)
    assert [c.stage for c in ranked] == ["registration"] * 4 + ["loops"]
    assert ranked[-1].reason == "2 boundary loops, the target has 1"


def test_the_chosen_one_is_the_best_of_all_transfers(target):
    """Second route: every model by itself."""
    found = pt.Library(shapes()).transfer(target, 4)
    least = {}
    for name, model in shapes().items():
        if name != "plate":
            proved = pt.transfer(model, target, continuity="c0", on_failure="return").quality.proved
            least[name] = proved.min_scaled_jacobian.lower
    assert found.chosen == max(least, key=least.get)
    for candidate in found.candidates[:4]:
        assert candidate.min_scaled_jacobian.lower == least[candidate.name]
    assert [c.stage for c in found.candidates] == ["chosen"] + ["transfer"] * 3 + ["loops"]


def test_the_registration_is_handed_over(target, monkeypatch):
    calls = []
    plain = library.Search._register_one
    monkeypatch.setattr(library.Search, "_register_one", lambda self, c: (calls.append(c.name), plain(self, c)))
    one = pt.Library(shapes()).transfer(target, 1)
    assert len(calls) == 4
    # As if there were no library, to the bit.
    alone = pt.transfer(shapes()["bar"], target, continuity="c0")
    assert np.array_equal(one.multipatch.topology.coordinates, alone.multipatch.topology.coordinates)
    assert one.result.timings["registration"] > 0
    assert set(one.result.timings) == set(alone.timings)


def test_fewer_are_registered_and_told(target):
    ranked = pt.Library(shapes()).rank(target, keep=2)
    assert [c.stage for c in ranked] == ["registration"] * 2 + ["signature"] * 2 + ["loops"]
    assert ranked[2].distance <= ranked[3].distance
    assert ranked[2].reason == "2 others are nearer by signature"


@pytest.mark.parametrize("angle", [35, 180])
def test_place_and_size_of_the_target_change_nothing(target, angle):
    # About the origin.
    turn = targets.similarity(angle, 2.5)
    moved = pt.Boundary([[c.with_control_points(turn(c.control_points)) for c in loop] for loop in target.loops])
    shelf_ = pt.Library(shapes())
    before, after = shelf_.rank(target), shelf_.rank(moved)
    assert [c.name for c in before] == [c.name for c in after]
    assert [c.distance for c in before[:4]] == pytest.approx([c.distance for c in after[:4]], rel=1e-6)


def test_what_cannot_be_transferred_says_why(target):
    found = pt.Library({"bar": shapes()["bar"], "folded": folded_source()}).transfer(target)
    assert found.chosen == "bar"
    refused = found.candidates[-1]
    assert (refused.name, refused.stage) == ("folded", "source")
    assert "patch 1 folds" in refused.reason
    assert "and 1 more: 1 that cannot be transferred" in str(found)


def test_others_are_tried_while_none_is_certified(target, monkeypatch):
    library_, tried = pt.Library(shapes()), []
    plain = pt.TransferPlan._ended

    def failing(self, begun, run):
        tried.append(len(self.source.patches))
        if len(tried) < 4:
            raise pt.InfeasibleTargetError("made to fail")
        return plain(self, begun, run)

    monkeypatch.setattr(pt.TransferPlan, "_ended", failing)
    found = library_.transfer(target, 1)
    assert len(tried) == 4
    assert found.succeeded
    assert [c.reason for c in found.candidates[1:4]] == ["made to fail"] * 3
    assert found.candidates[0].reason == "the only one certified"


def test_the_last_candidate_is_a_layout_of_the_targets_own():
    only = pt.Library({"plate": shapes()["plate"]})
    found = only.transfer(domains.L)
    assert found.chosen == PARAMETERIZE
    assert found.succeeded
    assert len(found.multipatch) == 3
    assert [c.name for c in found.candidates] == [PARAMETERIZE, "plate"]
    with pytest.raises(pt.InfeasibleTargetError, match="has 1 boundary loops, as the target has: 1 with 2; add one"):
        only.transfer(domains.L, parameterize=False)
    with pytest.raises(pt.InfeasibleTargetError, match="has 1 boundary loops"):
        only.rank(domains.L)


def test_a_layout_of_its_own_is_tried_where_no_model_fits_well(target, monkeypatch):
    bar = pt.Library({"bar": shapes()["bar"]})
    assert [c.name for c in bar.transfer(target).candidates] == ["bar"]
    # Nothing is good enough.
    monkeypatch.setattr(library, "POOR", 2.0)
    found = bar.transfer(target)
    least = {c.name: c.min_scaled_jacobian.lower for c in found.candidates}
    assert set(least) == {"bar", PARAMETERIZE}
    assert found.chosen == max(least, key=least.get)


def test_a_failure_says_what_was_tried(target, monkeypatch):
    def failing(self, begun, run):
        raise pt.InfeasibleTargetError("made to fail")

    monkeypatch.setattr(pt.TransferPlan, "_ended", failing)
    library_ = pt.Library(shapes())
    with pytest.raises(pt.NoModelFitsError, match=r"bar: made to fail; .*let parameterize make a layout") as caught:
        library_.transfer(target, parameterize=False)
    assert len(caught.value.result.candidates) == 5
    found = library_.transfer(target, parameterize=False, on_failure="return")
    assert (found.succeeded, found.chosen, found.result) == (False, None, None)
    with pytest.raises(pt.NoModelFitsError):
        _ = found.multipatch


def test_the_report_has_everything(target):
    found = pt.Library(shapes()).transfer(target)
    report = found.to_dict()
    assert report["certificate"]["injective"]
    assert report["library"]["chosen"] == found.chosen
    assert {c["name"] for c in report["library"]["candidates"]} == set(shapes())
    assert {"signatures", "registration", "transfer"} == set(report["library"]["timings"])
    head = str(found).splitlines()[0].split()
    assert head == ["model", "signature", "score", "confidence", "expected", "min", "SJ", "outcome"]


def test_bad_arguments():
    for given, message in (
        ({}, "empty"),
        ([1], "must be a mapping"),
        ({"a": 1}, r"models\['a'\] must be a MultiPatch"),
    ):
        with pytest.raises(pt.InputError, match=message):
            pt.Library(given)
    with pytest.raises(pt.InputError, match="continuity must be one of"):
        pt.Library(shapes(), "c7")
    library_ = pt.Library(shapes())
    for keywords, message in (({"tries": 0}, "tries"), ({"keep": 0}, "keep"), ({"fit_tolerance": 2}, "fit_tolerance")):
        with pytest.raises(pt.InputError, match=message):
            library_.transfer(domains.L, **keywords)
    with pytest.raises(pt.InputError, match="target must be a Boundary"):
        library_.rank(shapes()["bar"])
    with pytest.raises(pt.InfeasibleTargetError, match="crosses itself"):
        library_.rank(domains.BOW_TIE)


# --- files and what is kept of them ---------------------------------------------------------------


def test_kept_signatures_are_those_of_the_models(folder, tmp_path, target, monkeypatch):
    first = pt.Library.open(folder, cache=tmp_path / "kept")
    before = first.rank(target)
    assert [c.name.removesuffix(".xml") for c in before] == [c.name for c in pt.Library(shapes()).rank(target)]
    read = []
    plain = entries.read
    monkeypatch.setattr(entries, "read", lambda path: (read.append(path.stem), plain(path))[1])
    again = pt.Library.open(folder, cache=tmp_path / "kept")
    assert read == []
    assert again.rank(target, keep=1) == first.rank(target, keep=1)
    assert read == ["bar"]
    assert again.notes == ()


def test_a_changed_file_is_looked_at_again(folder, tmp_path, target):
    kept = tmp_path / "kept"
    opened = pt.Library.open(folder, cache=kept)
    pt.write(shapes()["long"], folder / "bar.xml")
    with pytest.raises(pt.InputError, match=r"bar.xml: changed since the library was opened"):
        _ = opened["bar.xml"]
    refused = {c.name: c for c in opened.rank(target)}["bar.xml"]
    assert refused.status == "not registered"
    assert "changed since" in refused.reason
    ranked = {c.name: c.distance for c in pt.Library.open(folder, cache=kept).rank(target)}
    assert ranked["bar.xml"] == ranked["long.xml"]


def test_what_was_kept_wrongly_is_found_and_worked_out_again(folder, tmp_path, target):
    kept = tmp_path / "kept"
    right = pt.Library.open(folder, cache=kept).rank(target)
    with sqlite3.connect(kept / NAME) as database:
        (size,) = database.execute("SELECT length(digits) FROM known").fetchone()
        database.execute("UPDATE known SET digits = ?", (np.linspace(0, 1, size // 8).tobytes(),))
    opened = pt.Library.open(folder, cache=kept)
    assert opened.rank(target) == right
    assert "worked out again" in opened.notes[0]
    mended = pt.Library.open(folder, cache=kept)
    assert mended.rank(target) == right
    assert mended.notes == ()


def test_the_key_is_of_content_suffix_and_versions(tmp_path, monkeypatch):
    key = key_of(tmp_path / "a.xml", b"1")
    assert key == key_of(tmp_path / "b.XML", b"1")
    assert key != key_of(tmp_path / "a.xml", b"2")
    assert key != key_of(tmp_path / "a.txt", b"1")
    monkeypatch.setattr("patchtransfer.library.index.VERSION", 10**6)
    assert key != key_of(tmp_path / "a.xml", b"1")


def test_a_cache_that_is_none_is_refused(folder, tmp_path, monkeypatch):
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / NAME).write_text("no database, whatever its name says; " * 50)
    with pytest.raises(pt.InputError, match=r"signatures.sqlite: signatures cannot be kept there .* delete it"):
        pt.Library.open(folder, cache=kept)
    with pytest.raises(pt.InputError, match="the folder cannot be made"):
        pt.Library.open(folder, cache=folder / "bar.xml")
    # The default one is gone without, and it is told.
    monkeypatch.setenv("PATCHTRANSFER_CACHE", str(kept))
    assert "worked out again each time" in pt.Library.open(folder).notes[0]
    assert pt.Library.open(folder, cache=False).notes == ()


def test_the_environment_names_the_cache(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("PATCHTRANSFER_CACHE", str(tmp_path / "named"))
    pt.Library.open(folder)
    assert (tmp_path / "named" / NAME).stat().st_size > 0


def test_an_old_table_is_not_taken_for_a_new_one(folder, tmp_path):
    pt.Library.open(folder, cache=tmp_path)
    with sqlite3.connect(tmp_path / NAME) as database:
        database.execute("PRAGMA user_version = 99")
    with pytest.raises(pt.InputError, match="made by another version; delete it"):
        pt.Library.open(folder, cache=tmp_path)


def test_files_that_are_no_models(folder, tmp_path):
    (folder / "notes.txt").write_text("to do\n")
    (folder / "picture.png").write_bytes(b"not looked at")
    (folder / ".hidden.xml").write_text("not looked at")
    with pytest.raises(pt.InputError, match=r"notes.txt: .*; mend or remove it, or .* --skip-unreadable"):
        pt.Library.open(folder, cache=False)
    opened = pt.Library.open(folder, cache=False, skip_unreadable=True)
    assert len(opened) == 5
    assert list(opened) == list(opened.names)
    assert len(opened.notes) == 1
    assert "notes.txt" in opened.notes[0]
    bad = tmp_path / "bad"
    bad.mkdir()
    for place, message in ((bad, "no models; none of its 0 files"), (tmp_path / "none", "no such folder")):
        with pytest.raises(pt.InputError, match=message):
            pt.Library.open(place, cache=False)
    (bad / "a.xml").write_text("<xml/>")
    with pytest.raises(pt.InputError, match="none of its 1 files can be read as a model"):
        pt.Library.open(bad, cache=False, skip_unreadable=True)
    with pytest.raises(pt.InputError, match="name the folder of the models"):
        pt.Library.open(folder / "bar.xml", cache=False)


def test_plans_are_kept_for_further_targets(target):
    library_ = pt.Library(shapes())
    made = library_._models._plan
    library_.rank(target)
    assert made.cache_info().misses == 4
    library_.rank(target)
    assert made.cache_info().misses == 4
    assert shelf.PLANS >= library.KEEP
