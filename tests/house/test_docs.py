"""The documentation names what the package has. That it builds, and its gallery runs, is checked by building it."""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

import patchtransfer as pt
from patchtransfer import limits

DOCS = Path(__file__).parents[2] / "docs"


def listed() -> list[str]:
    return re.findall(r"^   ([A-Za-z_][\w.]*)$", (DOCS / "api.md").read_text(), re.MULTILINE)


def test_api_lists_every_public_name():
    modules = {"autodiff": pt.autodiff, "iga": pt.iga, "plot": pt.plot}
    public = {name for name in pt.__all__ if name not in ("__version__", "batch", "examples", "reproduce", *modules)}
    public |= {f"{name}.{part}" for name, module in modules.items() for part in module.__all__}
    names = listed()
    assert len(names) == len(set(names))
    assert public <= set(names), public - set(names)


@pytest.mark.parametrize("name", [name for name in listed() if "." in name])
def test_names_of_modules_are_public_there(name):
    module, _, attribute = name.partition(".")
    assert attribute in import_module(f"patchtransfer.{module}").__all__


def test_every_public_function_has_an_example():
    """And so have the classes that one makes oneself; results are made by these functions, errors by mistakes."""
    made = {"MultiPatch", "Patch", "Boundary", "BSplineCurve", "QuadLayout", "TransferPlan", "Library", "Deformer"}
    made |= {"PaperOptions", "iga.PoissonSolver", "iga.SplineSpace"}
    for name in listed():
        module, _, attribute = name.rpartition(".")
        thing = getattr(import_module(f"patchtransfer.{module}" if module else "patchtransfer"), attribute)
        if inspect.isroutine(thing) or name in made:
            # Doctests of all modules run with the tests.
            assert ">>> " in (thing.__doc__ or ""), name


def test_quickstart_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "guide" / "quickstart.md").read_text(), re.DOTALL)
    assert len(blocks) == 2
    for code in blocks:
        exec(code, {})
    assert capsys.readouterr().out.startswith("True 0.9")
    assert pt.certify(pt.read("result.xml")).injective
    assert Path("result.png").stat().st_size > 10_000


def test_the_studio_in_a_notebook_is_as_the_guide_says(tmp_path, monkeypatch):
    pytest.importorskip("anywidget")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "guide" / "studio.md").read_text(), re.DOTALL)
    assert len(blocks) == 2
    exec("".join(blocks), {})
    assert pt.certify(pt.read("result.xml")).injective


def test_models_are_handed_on_as_the_guide_says():
    for name in ("splinepy", "geomdl", "nutils", "meshio", "skfem"):
        pytest.importorskip(name)
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "guide" / "hand-it-on.md").read_text(), re.DOTALL)
    known: dict[str, object] = {}
    with pytest.warns(pt.InputWarning, match="'right' is 2"):
        exec("".join(blocks), known)
    # The plate's area without its holes, and the side of its model that has the name.
    assert len(known["basis"]) == known["mp"].topology.n_points
    assert known["height"] == pytest.approx(known["facets"].dx.sum(), rel=1e-3)
    assert known["area"] == pytest.approx(skfem_area(known["mesh"]), rel=1e-3)


def skfem_area(mesh) -> float:
    import skfem

    return float(skfem.CellBasis(mesh, skfem.ElementQuad1()).dx.sum())


def test_every_stage_page_is_listed_and_has_its_parts():
    index = (DOCS / "stages" / "index.md").read_text()
    for page in (DOCS / "stages").glob("*.md"):
        if page.name != "index.md":
            text = page.read_text()
            assert f"({page.name})" in index
            assert re.search(r"\*\*(Computes|Morph)", text), page.name
            assert "**Limits.**" in text, page.name
            assert len(text.splitlines()) <= 60, f"{page.name}: two screens at most"
            root = Path(pt.__file__).parent
            for module in re.findall(r"`(?:patchtransfer\.)?([\w.]+)`", text.splitlines()[-1].partition(";")[0]):
                place = root / module.replace(".", "/")
                assert place.is_dir() or place.with_suffix(".py").exists(), f"{page.name}: {module}"


def test_every_gallery_script_asserts_a_number():
    scripts = sorted((DOCS / "gallery").glob("*.py"))
    assert len(scripts) >= 8
    for script in scripts:
        assert re.search(r"^ *assert .*[<>=]", script.read_text(), re.MULTILINE), script.name


def test_the_guide_lists_the_upper_bounds():
    table = (DOCS / "guide" / "files.md").read_text().partition("## Upper bounds")[2]
    digits = {float(n.replace(" ", "")) for n in re.findall(r"\d+e\d+|\d+(?: \d{3})*", table)}
    for name in limits.__all__:
        if name.startswith("MAX_"):
            value = getattr(limits, name)
            value = value // 2**20 if name.endswith("_BYTES") else 2 * value if name == "MAX_LINES" else value
            assert value in digits, name
