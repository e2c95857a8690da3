"""``mbstab compare``: errors against an independent truth, what is lost, the choice, the tables of the paper."""

import csv
import functools
import io
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from chains import hanging_chain
from click.testing import CliRunner
from mpmath import mp
from sampling import sample
from truth import DIGITS, exact_eigenvalues

import mbstab
from mbstab.analysis.algebra.matching import matched
from mbstab.analysis.compare import methods
from mbstab.analysis.compare.methods import Outcome, cheapest
from mbstab.analysis.linear import acceleration_methods
from mbstab.analysis.linear.acceleration_methods import augmented
from mbstab.analysis.linear.methods import METHODS
from mbstab.cli import main
from mbstab.errors import NumericalError, UsageError
from mbstab.report.pictures.drawing import save
from mbstab.report.pictures.work_precision import work_precision

TECHNIQUES = ["augmented", "embedding", "amalgamated", "projection", "udwadia-kalaba"]


@pytest.fixture(scope="module", autouse=True)
def quick():
    """Times need not be good here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mbstab.analysis.compare.tolerances.Tolerances.method_timings", 3)
        yield


def run(*arguments):
    return CliRunner().invoke(main, ["compare", *arguments])


# Below 21 digits of the truth nothing is measured besides double precision; it has the same working digits.
@functools.cache
def compared(name, tolerance=None, digits=20, **parameters):
    return mbstab.load(f"{name}.yaml").compare(digits, tolerance, **parameters)


def by_name(result):
    return {x.method: x for x in result.outcomes}


# --- errors ---------------------------------------------------------------------------------------------------------


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("name", "parameters"),
    sample(
        [
            ("pendulum", {}),
            ("wheeled_inverted_pendulum", {}),
            ("top", {"omega": "5.6"}),
            ("rolling_disk", {"omega": "0.1"}),
            ("whipple_bicycle", {"v": "5.1"}),
        ],
        2,
    ),
)
def test_errors_are_distances_from_an_independent_truth(name, parameters):
    result = compared(name, **parameters)
    exact, neutral = exact_eigenvalues(mbstab.load(f"{name}.yaml").model, **parameters)
    moving = np.array([s != 0 for s in result.truth.values()])
    assert result.truth.neutral + np.sum(~moving) == neutral
    assert np.sum(moving) == len(exact)
    for x in result.outcomes[: len(METHODS)]:
        with mp.workdps(DIGITS):
            errors = []
            for s, found in zip(map(mp.mpmathify, result.truth.values()), x.values, strict=True):
                if not s:
                    continue  # zeros that nothing explains
                true = min(exact, key=lambda other, s=s: abs(other - s))
                errors.append(float(abs(mp.mpmathify(complex(found)) - true) / abs(true)))
        # Relative to one rounding: where nothing is off, both are exactly 0.
        np.testing.assert_allclose(x.errors[moving], errors, rtol=1e-9, atol=1e-30, err_msg=x.method)
        assert not x.exceeded
        assert (x.lost, x.invented) == (0, 0)


def test_digits_are_as_wrong_as_their_last_one():
    for n in (20, 30):
        x = by_name(compared("top", digits=50, omega="5.6"))[f"{n} digits"]
        assert 10.0 ** (-n - 2) < x.error <= 0.5 * 10.0 ** (1 - n)


def test_what_rounding_of_the_data_does_is_told_from_what_the_method_does():
    """At 5.6 = 5.60000000000000053… the distance to the true 5.6 is in no method's power."""
    result = compared("top", omega="5.6")
    with mp.workdps(40):
        model = mbstab.load("top.yaml")
        exact, off = (
            [mp.mpmathify(e.value) for e in model.eig_precise(30, omega=omega).eigenvalues]
            for omega in ("5.6", mp.mpf(5.6))
        )
        moved = max(float(abs(x - y) / abs(x)) for x, y in zip(exact, off, strict=True))
    assert 0.1 * moved < np.max(result.rounding) < 20 * max(moved, 1e-16)
    for x in result.outcomes[: len(METHODS)]:
        difference = np.abs(x.errors - x.own_errors)
        assert np.all(difference <= result.rounding + 1e-25)
        assert np.all(x.errors <= x.own_errors + result.rounding + 1e-25)


def test_rounding_near_a_collision_is_most_of_the_error():
    result = compared("top", digits=30, omega="5.5677284416535")
    assert np.max(result.rounding) > 1e-11
    assert by_name(result)["20 digits"].error < 1e-19


# --- lost and invented ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def heavy_chain():
    """Each link weighs 12.6 times as much as the one above."""
    text = hanging_chain(np.random.default_rng(1), 10, [10.0 ** (1.1 * i) for i in range(10)])
    return mbstab.loads(text, "chain").compare(20)


@pytest.mark.long
def test_what_qz_loses_is_counted(heavy_chain):
    """Whether it loses any here is up to the rounding of the processor."""
    assert len(heavy_chain.truth.eigenvalues) == 20
    found = by_name(heavy_chain)
    assert (found["nullspace"].lost, found["nullspace"].invented) == (0, 0)
    assert found["nullspace"].error < 1e-4
    x = found["paper"]
    assert x.lost == np.isnan(x.errors).sum()
    assert math.isinf(x.error) == (x.lost + x.invented > 0)


@pytest.mark.parametrize(("lost", "invented"), [(0, 0), (2, 0), (0, 1), (4, 3)])
def test_what_a_method_loses_and_invents_is_counted(monkeypatch, lost, invented):
    def careless(linear, gamma, known):
        found = augmented(linear, gamma, known)
        others = 1e3 * gamma * np.arange(1.0, invented + 1.0)
        return replace(
            found,
            values=np.append(found.values[lost:], others),
            vectors=np.hstack([found.vectors[:, lost:], found.vectors[:, :invented]]),
        )

    monkeypatch.setattr(acceleration_methods, "augmented", careless)
    x = by_name(mbstab.loads(hanging_chain(np.random.default_rng(1), 3), "chain").compare(20))["augmented"]
    assert (x.lost, x.invented) == (lost, invented)
    assert np.isnan(x.errors).sum() == lost
    assert math.isinf(x.error) == (lost + invented > 0)
    assert not np.nanmax(x.errors) > 1e-9


@pytest.mark.parametrize("name", ["index3", "paper"])
def test_the_counts_are_those_of_the_plain_answer(name):
    x = by_name(compared("bricard"))[name]
    plain = mbstab.load("bricard.yaml").eig(name)
    assert plain.counts.expected - x.lost + x.invented == plain.counts.found
    assert np.isnan(x.values).sum() == x.lost


@pytest.mark.long
def test_a_zero_that_is_not_there_is_lost_too():
    for name in ("wheeled_inverted_pendulum", "whipple_bicycle", "free_rigid_body"):
        for x in compared(name).outcomes:
            assert (x.lost, x.invented) == (0, 0)


# --- the choice -----------------------------------------------------------------------------------------------------


@pytest.mark.few(3)
@pytest.mark.parametrize("tolerance", [1e-3, 1e-10, 1e-18, 1e-25, 1e-48])
def test_the_chosen_method_keeps_the_tolerance_and_no_cheaper_one_does(tolerance):
    result = compared("pendulum", tolerance, 50)
    assert result.chosen is not None
    assert result.chosen.error <= tolerance
    for x in result.outcomes:
        assert x.error > tolerance or x.seconds * 1.1 >= result.chosen.seconds


def test_the_choice_is_explained():
    result = run("top.yaml", "--set", "omega=5.5677284416535", "--tol", "1e-14")
    assert result.exit_code == 0
    last = " ".join(result.stdout.split("\n\n")[-1].split())
    assert "digits keeps 1e-14: error" in last
    assert "faster ones do not: nullspace (" in last


def test_no_method_keeps_the_tolerance():
    nothing = np.zeros(1)
    rough = Outcome("paper", nothing, np.array([1e-9]), nothing, nothing, seconds=1.0)
    wrong = Outcome("index3", nothing, nothing, nothing, nothing, lost=1, seconds=0.1)
    assert cheapest([wrong, rough], 1e-8, rough.verdict) is rough
    with pytest.raises(NumericalError, match=r"no method keeps 1e-10: paper comes closest with 1.0e-09\nhint: .* 16"):
        cheapest([wrong, rough], 1e-10, rough.verdict)
    with pytest.raises(NumericalError, match=r"no method keeps 0\.5\n"):
        cheapest([wrong], 0.5, wrong.verdict)


def test_it_fails_with_one(monkeypatch):
    def refused(outcomes, tolerance, verdict):
        return cheapest(outcomes[1:2], 1e-30, verdict)

    monkeypatch.setattr(methods, "cheapest", refused)
    result = run("pendulum.yaml", "--tol", "1e-3")
    assert result.exit_code == 1
    assert "hint: mbstab eig --precision" in result.stderr
    assert result.stdout == ""


# --- the paper ------------------------------------------------------------------------------------------------------

# Its error rows compare two methods in double precision with each other: the distance (1/s) of the largest of
# eigenvalues that the five techniques have from those of its own method. Here each is compared with the truth.
PRINTED = {
    ("pendulum", None): [1.77635e-15, 1.77626e-15, 8.88178e-16, 8.88109e-16, 1.77573e-15],
    ("wheeled_inverted_pendulum", None): [7.9936e-15, 6.5732e-16, 8.2321e-16, 8.8818e-16, 1.7764e-15],
    ("top", "4"): [6.9369e-15, 7.7684e-15, 6.9353e-15, 6.4355e-15, 5.1789e-15],
    ("top", "5.6"): [1.0442e-14, 1.8726e-14, 1.0433e-14, 2.4237e-15, 1.9138e-14],
    ("top", "10"): [1.7015e-15, 5.0561e-15, 7.6685e-15, 2.5945e-15, 7.7058e-15],
    ("rolling_disk", "1"): [1.908e-8, 1.912e-8, 1.900e-8, 1.821e-8, 1.917e-8],
    # The column printed as 3.4 belongs to 3.33.
    ("rolling_disk", "3.33"): [4.4640e-7, 4.4538e-7, 4.4721e-7, 4.4543e-7, 4.4622e-7],
    ("rolling_disk", "5"): [2.2261e-14, 2.2473e-14, 2.2233e-14, 2.2209e-14, 2.2211e-14],
}
ORDER = 10.0
"""Of the printed order: which roundings meet is chance."""


@pytest.mark.parametrize(("name", "omega"), sample(PRINTED, 3))
def test_errors_are_of_the_order_that_tables_2_4_6_8_print_or_smaller(name, omega):
    found = by_name(compared(name, **({"omega": omega} if omega else {})))
    moduli = [abs(complex(s)) for s in compared(name, **({"omega": omega} if omega else {})).truth.values()]
    for method, printed in zip(TECHNIQUES, PRINTED[name, omega], strict=True):
        assert np.max(found[method].errors * moduli) <= ORDER * printed, method


@pytest.mark.long
@pytest.mark.parametrize("omega", sample(["20", "0"], 2))
def test_the_five_techniques_are_applicable_to_the_governor(omega):
    found = by_name(compared("governor", omega=omega))
    for method in METHODS:
        assert found[method].error < 1e-10
        assert found[method].failure == ""
        assert not found[method].exceeded


# --- reports --------------------------------------------------------------------------------------------------------


def test_json_has_the_keys_that_are_documented():
    result = run("bricard.yaml", "--tol", "1e-10", "--digits", "21", "--format", "json")
    assert result.exit_code == 0, result.stderr
    assert "NaN" not in result.stdout
    assert "Infinity" not in result.stdout
    data = json.loads(result.stdout)
    assert list(data) == [
        "model", "title", "digits", "truth", "neutral", "verdict", "rounding", "seconds", "methods", "tolerance",
        "chosen",
    ]  # fmt: skip
    assert data["digits"] == 21
    assert data["truth"][0]["real"] == "0"
    assert data["truth"][0]["imag"].startswith("1.24129865")
    assert len(data["truth"][0]["imag"]) == 22
    methods = {x["method"]: x for x in data["methods"]}
    assert list(methods) == [*METHODS, "20 digits"]
    for x in methods.values():
        assert set(x) == {
            "method", "values", "errors", "own_errors", "bounds", "error", "own_error", "bound", "exceeded", "lost",
            "invented", "zeros", "drift", "besides", "verdict", "seconds", "memory", "failure",
        }  # fmt: skip
        assert len(x["values"]) == len(x["errors"]) == len(x["bounds"]) == len(data["truth"])
    refused = methods["augmented"]
    assert "needs independent constraint rows" in refused["failure"]
    assert [refused[key] for key in ("error", "lost", "seconds", "memory")] == [None] * 4
    assert methods["nullspace"]["failure"] is None
    assert methods["nullspace"]["memory"] > 1000
    assert methods[data["chosen"]]["error"] <= 1e-10


def test_csv_is_one_row_for_each_method_and_eigenvalue():
    result = run("pendulum.yaml", "--format", "csv")
    rows = list(csv.reader(io.StringIO(result.stdout)))
    assert rows[0][:3] == ["method", "true real (1/s)", "true imag (1/s)"]
    assert len(rows) == 1 + 2 * (len(METHODS) + 2)
    assert rows[1][0] == "nullspace"
    assert float(rows[1][5]) < 1e-15


@pytest.mark.parametrize("model", sample(["bricard", "whipple_bicycle", "trailer", "pendulum"], 3))
def test_the_table_fits_eighty_columns_and_says_what_is_missing(model):
    result = run(f"{model}.yaml", "--digits", "50" if model == "trailer" else "20")
    assert result.exit_code == 0, result.stderr
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert "nan" not in result.stdout
    assert "0e+00" not in result.stdout
    assert ("no answer by 4, 5, 6, 7: needs independent" in result.stdout) == (model == "bricard")


@pytest.mark.long
def test_many_eigenvalues_take_several_tables(heavy_chain):
    from mbstab.report.comparison import compare_text

    text = compare_text(heavy_chain, None)
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("eigenvalue (1/s)") > 1


def test_a_fully_prescribed_motion_has_nothing_to_compare(tmp_path):
    path = tmp_path / "driven.yaml"
    path.write_text(
        "mbstab: 1\nbodies: {b: {type: planar, mass: 1, inertia: 1}}\n"
        "joints: {pin: {type: fixed, between: [b, ground]}}\n",
        encoding="utf-8",
    )
    result = run(str(path))
    assert result.exit_code == 0, result.stderr
    assert "Verdict with 50 digits: undecided" in result.stdout
    data = run(str(path), "--format", "json").stdout
    assert json.loads(data)["truth"] == []


def test_the_picture_has_one_point_for_each_method(tmp_path):
    result = compared("bricard")
    # What QZ loses in a singular pencil is up to the rounding of the processor.
    outcomes = [replace(x, lost=2) if x.method == "index3" else x for x in result.outcomes]
    result = replace(result, outcomes=tuple(outcomes), tolerance=1e-10)
    figure = work_precision(result, "Bricard")
    (axes,) = figure.axes
    shown = [n for n, x in enumerate(result.outcomes, 1) if math.isfinite(x.error)]
    texts = [text.get_text() for text in axes.texts]
    assert [text for text in texts if text.isdigit()] == [str(n) for n in shown]
    key = next(text for text in texts if "\n" in text)
    assert "2  index3: 2 lost" in key
    assert "4  augmented: no answer" in key
    points = [line for line in axes.get_lines() if line.get_marker() in ("o", "v")]
    assert len(points) == len(shown)
    low, high = axes.get_ylim()
    assert all(low < line.get_ydata()[0] < high for line in points)
    assert low < 1e-10 < high
    assert axes.get_xlabel().startswith("time (ms)")
    save(figure, tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_an_error_of_nothing_is_drawn_at_the_bottom():
    result = compared("trailer", digits=50)
    (axes,) = work_precision(result, "").figure.axes
    assert min(line.get_ydata()[0] for line in axes.get_lines() if line.get_marker() == "v") >= 1e-17


def test_many_digits_are_told_and_do_not_squeeze_the_picture():
    result = compared("pendulum", digits=50)
    (axes,) = work_precision(result, "").figure.axes
    assert axes.get_ylim()[0] > 1e-26  # room for the list below 1e-17
    key = next(text.get_text() for text in axes.texts if "\n" in text.get_text())
    assert re.search(r"30 digits: \de\N{MINUS SIGN}3\d", key)
    # Where a tolerance asks for digits they are drawn.
    (axes,) = work_precision(replace(result, tolerance=1e-25), "").figure.axes
    assert axes.get_ylim()[0] < 1e-30


# --- bad input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", ["0", "-1e-3", "nan", "inf", "1", "abc", "1e-49"])
def test_a_tolerance_that_is_none_is_refused(tolerance):
    result = run("pendulum.yaml", "--tol", tolerance)
    assert result.exit_code == 2
    assert "--tol" in result.stderr
    assert result.stdout == ""


def test_memory_is_traced_when_line_numbers_are_ready(monkeypatch):
    prepared, own = [], methods._prepared
    monkeypatch.setattr(methods, "_prepared", lambda run: prepared.append(run) or own(run))
    outcomes = mbstab.load("pendulum.yaml").compare(50).outcomes
    assert len(prepared) == len(outcomes) > len(METHODS)


def test_a_tolerance_below_the_digits_says_how_many_it_needs():
    assert "hint: --digits 51" in run("pendulum.yaml", "--tol", "1e-49").stderr
    assert run("pendulum.yaml", "--tol", "1e-49", "--digits", "51").exit_code == 0


def test_a_periodic_motion_is_refused():
    result = run("kapitza.yaml")
    assert result.exit_code == 2
    assert "periodic motion" in result.stderr
    assert "--precision" not in result.stderr
    with pytest.raises(UsageError):
        compared("kapitza")


@pytest.mark.parametrize("place", ["nowhere/x.png", "x.txt"])
def test_a_picture_that_cannot_be_written_is_refused_first(tmp_path, monkeypatch, place):
    monkeypatch.chdir(tmp_path)
    result = run("governor.yaml", "--plot", "error", "--pictures", place)
    assert result.exit_code == 2
    assert place.partition("/")[0] in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_setting_is_its_decimals():
    """0.1 is not the double next to it: the truth differs from that of the double in the 17th digit."""
    text = compared("top", digits=50, omega="5.6").truth.eigenvalues[0].imag
    with mp.workdps(50):
        double = mbstab.load("top.yaml").eig_precise(50, omega=mp.mpf(5.6)).eigenvalues[0].imag
    assert text[:14] == double[:14]
    assert text != double
    assert matched([complex(0, float(text))], [complex(0, float(double))])[0] < 1e-14
