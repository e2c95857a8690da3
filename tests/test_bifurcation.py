"""References that are found, over the parameter of a sweep: as data, and as a picture of stable and unstable parts."""

import csv
import io
import json

import numpy as np
import pytest
from test_cli import run

import mbstab
from mbstab.errors import UsageError
from mbstab.report.export import sweep_csv, sweep_data, to_json
from mbstab.report.pictures.bifurcation import _pieces, bifurcation, shown_names
from mbstab.report.pictures.curves import INK
from mbstab.report.pictures.scales import Axis
from mbstab.report.pictures.sweep_curves import SweepCurves

TRUSS, PENDULUM, CAR = (mbstab.load(f"{name}.yaml") for name in ("von_mises_truss", "rotating_pendulum", "car_turn"))


def load_on(y):
    """Return the load of the truss at a height of its apex, in closed form."""
    k, a, h = (TRUSS.parameters()[name] for name in ("k", "a", "h"))
    return 2.0 * k * y * (np.hypot(a, h) / np.hypot(a, y) - 1.0)


@pytest.fixture(scope="module")
def truss():
    return TRUSS.sweep("P", np.linspace(-10.0, 10.0, 41))


def test_coordinates_of_all_paths_are_the_closed_form(truss):
    assert len(truss.beyond) == 2
    for path in (truss, *truss.beyond):
        known = np.isfinite(path.reference["apex.y"])
        assert known.sum() >= 15
        np.testing.assert_allclose(load_on(path.reference["apex.y"][known]), path.values[known], rtol=0, atol=1e-12)
        assert np.array_equal(~known, np.isnan(path.branches).any(axis=1))


def test_descending_sweeps_have_coordinates_in_their_order():
    values = np.linspace(20.0, 5.0, 31)
    found = PENDULUM.sweep("Omega", values)
    np.testing.assert_allclose(found.reference["bob.z"], -PENDULUM.parameters()["g"] / values**2, rtol=1e-12)
    np.testing.assert_allclose(found.reference["rate(fork.psi)"], values, rtol=1e-14)


def test_given_references_have_none():
    assert mbstab.load("top.yaml").sweep("omega", np.linspace(1.0, 10.0, 5)).reference == {}


def test_csv_and_json_have_the_coordinates(truss):
    rows = list(csv.DictReader(io.StringIO(sweep_csv(truss, "N", 1.0))))
    column = [float(row["apex.y (m)"] or "nan") for row in rows]
    whole = np.concatenate([path.reference["apex.y"] for path in (truss, *truss.beyond)])
    assert np.array_equal(column, whole, equal_nan=True)
    data = json.loads(to_json(sweep_data(truss, "N", 1.0, "truss", "")))
    assert data["beyond"][1]["reference"]["apex.y"] == truss.beyond[1].reference["apex.y"].tolist()


def test_curves_go_round_folds_and_tell_stable_from_unstable(truss):
    curves = SweepCurves(truss, Axis("P", "N"))
    pieces = _pieces(truss, curves, 1.0, ["apex.y"])
    a, h = (TRUSS.parameters()[name] for name in ("a", "h"))
    turn = np.sqrt(np.cbrt(np.hypot(a, h) * a**2) ** 2 - a**2)
    for piece in pieces:
        y = piece.columns["apex.y"]
        np.testing.assert_allclose(load_on(y), piece.x, rtol=0, atol=0.02)
        assert piece.state == (1 if abs(y[len(y) // 2]) < turn else 0)
    heights = np.concatenate([piece.columns["apex.y"] for piece in pieces])
    assert np.max(np.diff(np.sort(heights))) < 0.02
    figure = bifurcation(truss, Axis("P", "N"), "truss")
    assert figure.axes[0].get_ylabel() == "apex.y (m)"


def test_a_reference_that_does_not_depend_on_the_parameter_has_no_empty_picture():
    swept = TRUSS.sweep("m", np.linspace(1.0, 2.0, 5))
    with pytest.raises(UsageError, match="no coordinate of the reference depends on m"):
        bifurcation(swept, Axis("m", "kg"), "")
    (axes,) = bifurcation(swept, Axis("m", "kg"), "", ["apex.y"]).axes
    assert len(axes.get_lines()) == 1


def test_what_the_parameter_changes_is_drawn_and_the_rest_counted():
    found = CAR.sweep("steer", np.linspace(0.01, 0.05, 9))
    assert shown_names(found, ())[0] == ["car.y", "car.x", "rate(car.y)", "rate(car.theta)"]
    assert shown_names(found, ["rate(car.theta)"]) == (["rate(car.theta)"], 0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["top.yaml", "--param", "omega", "--plot", "path"], "draws a reference that is found"),
        (["von_mises_truss.yaml", "--param", "P", "--coordinate", "apex.y"], "goes with --plot path"),
        (["von_mises_truss.yaml", "--param", "P", "--plot", "path", "--coordinate", "apex.z"], "did you mean 'apex.y'"),
    ],
)
def test_what_cannot_be_drawn_is_refused(words, said):
    answer = run("sweep", *words)
    assert answer.exit_code == 2
    assert said in " ".join(answer.output.split())


def test_the_legend_tells_names_from_lines(truss):
    """Names belong to colours, where there is more than one curve in a panel, and lines to stability."""
    legend = bifurcation(truss, Axis("P"), "").legends[0]
    assert [x.get_text() for x in legend.get_texts()] == [
        "stable",
        "unstable",
        "critical value",
        "where it is critical",
    ]
    stable, unstable = legend.get_lines()[:2]
    assert [stable.get_color(), unstable.get_color(), stable.get_linestyle()] == [INK[0], INK[0], "-"]
    car = bifurcation(CAR.sweep("steer", np.linspace(0.03, 0.07, 9)), Axis("steer"), "")
    names = [x.get_text() for x in car.legends[0].get_texts()]
    assert names[:2] == ["car.y", "car.x"]
    assert not [name for name in names if name.startswith("rate(")]  # each alone in its panel
    assert "no answer" in names


def test_what_has_no_answer_begins_where_the_path_ends():
    """The steady turn ends in a fold, 0.0584430954089223 rad, between two points of the sweep."""
    found = list(SweepCurves(CAR.sweep("steer", np.linspace(0.03, 0.07, 9)), Axis("steer")).ranges())
    assert found == [(pytest.approx(0.0584430954089223, rel=1e-8), 0.07, -1)]
    down = list(SweepCurves(CAR.sweep("steer", np.linspace(0.07, 0.03, 9)), Axis("steer")).ranges())
    assert down == found
