"""The gallery's reduced-order model runs, and predicts unseen shapes."""

import importlib.util
from pathlib import Path

import numpy as np

SCRIPT = Path(__file__).parents[2] / "docs" / "gallery" / "reduced_order_model.py"


def load():
    spec = importlib.util.spec_from_file_location("reduced_order_model", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_ten_modes_predict_unseen_plates(tmp_path, capsys):
    error = load().main(str(tmp_path / "plate.png"))
    # Not exact either: then the unseen would have been seen.
    assert 1e-6 < error < 2e-3
    assert "unseen plate 4" in capsys.readouterr().out
    assert (tmp_path / "plate.png").stat().st_size > 10_000


def test_modes_are_the_leading_ones():
    rng = np.random.default_rng(0)
    snapshots = rng.normal(size=(40, 3)) @ rng.normal(size=(3, 12))
    basis, sigma = load().pod(snapshots, 3)
    assert sigma[3] < 1e-12 * sigma[0]
    np.testing.assert_allclose(basis @ (basis.T @ snapshots), snapshots, atol=1e-12)
