"""Derivatives of eigenvalues by parameters, against closed forms and against differences with many digits."""

import csv
import itertools
import json
import math
from pathlib import Path

import mpmath
import numpy as np
import pytest
from click.testing import CliRunner
from differences import differences

import mbstab
from mbstab import load, loads
from mbstab.cli import main
from mbstab.errors import MbstabError, UsageError
from mbstab.report.pictures.sensitivity_bars import sensitivity_bars


def slopes(found, name, number=0):
    return found.derivatives[number].slopes[found.parameters.index(name)]


def assert_slopes(mechanism, names, tolerance=1e-10):
    found = mechanism.sensitivities()
    scales = np.where(found.values, np.abs(found.values), 1.0)
    compared = 0
    for name in names:
        k = found.parameters.index(name)
        assert name not in found.missing
        exact = differences(mechanism, name)
        for item in found.derivatives:
            if not item.missing:
                row = np.nanmax(np.abs(item.slopes) * scales) / scales[k]
                off = abs(item.slopes[k] - exact(found.eigenvalue(item).value))
                assert off <= tolerance * row
                assert off <= item.errors[k] + 1e-14 * row  # the estimate is no fiction
                compared += 1
    assert compared
    return found


def test_a_pendulum():
    found = load("pendulum.yaml").sensitivities()
    assert slopes(found, "L") == pytest.approx(-15.1631749643667965j, rel=1e-14)
    assert slopes(found, "g") == pytest.approx(0.309137104268436218j, rel=1e-14)
    assert abs(slopes(found, "m")) < 1e-14  # the inertia is written in terms of m
    # omega = sqrt(m g L/(I + m L**2)) with I = m L**2/3.
    assert slopes(found, "I_zz") == pytest.approx(-6.0652699857467186j / (2 * 4 / 3 * 0.2**2), rel=1e-14)


def test_the_whipple_bicycle():
    found = load("whipple_bicycle.yaml").sensitivities(v=5)
    weave, capsize, castering = (
        next(i for i, x in enumerate(found.derivatives) if abs(found.eigenvalue(x).value - s) < 0.01)
        for s in (-0.7753 + 4.4649j, -0.3229, -14.078)
    )
    for number, exact in (
        (capsize, 0.5592202429888759),
        (weave, -0.891101156940564913 + 1.47048886071312979j),
        (castering, -1.96740590634654969),
    ):
        error = found.derivatives[number].errors[found.parameters.index("v")]
        assert abs(slopes(found, "v", number) - exact) <= error <= 1e-10


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("model", "names"),
    [
        ("top.yaml", ["I_z", "omega"]),  # a drive
        ("rolling_disk.yaml", ["omega", "R"]),  # in a turning frame, nonholonomic, with neutral directions
        ("shimmy.yaml", ["a"]),
        ("wheelset.yaml", ["h"]),
        ("free_rigid_body.yaml", ["I2"]),
    ],
)
def test_models_against_differences_of_30_digits(model, names):
    assert_slopes(load(model), names)


HUNG = """
mbstab: 1
parameters: {m: 2.0, k: 300.0, l: 0.4, d: 0.05}
gravity: [0, -9.81]
bodies:
  beam: {type: planar, mass: m, inertia: 0.1*m*l**2, points: {A: [-l, 0], B: [l, d]}}
joints:
  left: {type: point_on_line, between: [ground, beam.A], axis: [0, 1]}
  right: {type: point_on_line, between: [ground, beam.A], axis: [0, 1]}
forces:
  spring: {type: expression, on: {beam.y: -k*beam.y, beam.theta: -k*(beam.theta - d)}}
reference: {find: equilibrium}
"""


def test_redundant_rows_and_a_reference_that_moves():
    mechanism = loads(HUNG)
    assert mechanism.eig().counts.rank_holonomic < 2
    assert_slopes(mechanism, ["m", "k", "l", "d"])


SPRING = """
mbstab: 1
parameters: {m: 1.0, k: 4.0, c: 0.0, x_0: 0.3}
bodies:
  a: {type: planar, mass: m, inertia: 1}
forces:
  spring: {type: expression, on: {a.x: -k*(a.x - x_0) - c*rate(a.x), a.y: -4*a.y, a.theta: -25*a.theta}}
reference:
  coordinates: {a: {x: 0.3, y: 0, theta: 0}}
"""


def test_equal_eigenvalues_have_no_derivative_and_say_so():
    found = loads(SPRING).sensitivities()
    double, single = sorted(found.derivatives, key=lambda x: not x.missing)[::2]
    assert "2 eigenvalues cannot be told apart" in double.missing
    assert np.isnan(double.slopes).all()
    assert found.eigenvalue(single).value == pytest.approx(5j)
    assert not single.missing


def test_a_given_position_that_does_not_follow_a_parameter():
    found = loads(SPRING).sensitivities()
    assert set(found.missing) == {"x_0"}
    assert "do not balance" in found.missing["x_0"]
    assert all(math.isnan(abs(x.slopes[found.parameters.index("x_0")])) for x in found.derivatives)


def test_no_parameters_is_an_error_in_words():
    with pytest.raises(UsageError, match="no parameters"):
        loads("mbstab: 1\nbodies:\n  a: {type: planar, mass: 1, inertia: 1}\n").sensitivities()


def test_a_periodic_motion_is_refused():
    with pytest.raises(MbstabError, match="without derivatives"):
        load("kapitza.yaml").sensitivities()


KINK = """
mbstab: 1
parameters: {k: 4.0, e: 0.0}
bodies:
  a: {type: planar, mass: 1, inertia: 1}
forces:
  spring: {type: expression, on: {a.x: -(k + abs(e))*a.x, a.y: -9*a.y, a.theta: -25*a.theta}}
"""


def test_a_kink_at_the_value_of_a_parameter_is_named():
    """By the others there are derivatives: 2i sqrt(k) has i/(2 sqrt(k))."""
    table = KINK.replace("forces:", "tables: {T: {x: [-1, 0, 1], y: [-1, 0, 3]}}\nforces:")
    for text, reason in (
        (KINK, "abs has no derivative at 0"),
        (table.replace("-(k + abs(e))*a.x", "'-(k + linear(e, T))*a.x'"), "meet at 0"),
    ):
        found = loads(text).sensitivities()
        assert list(found.missing) == ["e"]
        assert reason in found.missing["e"]
        (item,) = (x for x in found.derivatives if abs(found.eigenvalue(x).value - 2j) < 1e-9)
        k, e = (found.parameters.index(name) for name in ("k", "e"))
        assert item.slopes[k] == pytest.approx(0.25j, rel=1e-13)
        assert np.isnan(item.slopes[e])


def test_the_command_prints_what_moves_an_eigenvalue_most_first():
    run = CliRunner().invoke(main, ["eig", "top.yaml", "--sensitivity"], catch_exceptions=False)
    assert run.exit_code == 0, run.output
    lines = run.stdout.rstrip().splitlines()
    assert lines[-9] == "0 ± 11.5865i 1/s"
    assert [line.split()[0] for line in lines[-6:]] == ["I_z", "omega", "I_x", "H", "m", "g"]
    assert lines[-6].split() == ["I_z", "kg*m^2", "0", "+", "34871.124i", "0", "+", "0.1395i", lines[-6].split()[-1]]


def test_json_and_csv_have_the_derivatives_per_declared_unit():
    text = (Path(mbstab.__file__).parents[1] / "models" / "pendulum.yaml").read_text(encoding="utf-8")
    arguments = ["eig", "-", "--sensitivity", "--format"]
    file = text.replace("L: {value: 0.2, unit: m,", "L: {value: 200, unit: mm,")
    run = CliRunner().invoke(main, [*arguments, "json"], input=file, catch_exceptions=False)
    (item,) = json.loads(run.stdout)["sensitivity"]["eigenvalues"]
    assert item["derivatives"]["L"]["imag"] == pytest.approx(-0.0151631749643667965, rel=1e-13)
    assert item["derivatives"]["L"]["percent_imag"] == pytest.approx(-0.030326349928733593, rel=1e-13)
    run = CliRunner().invoke(main, [*arguments, "csv"], input=file, catch_exceptions=False)
    lines = {row["parameter"]: row for row in csv.DictReader(run.stdout.splitlines())}
    assert float(lines["L"]["derivative_imag"]) == item["derivatives"]["L"]["imag"]
    assert lines["L"]["unit"] == "mm"


def test_options_that_contradict_are_refused():
    run = CliRunner().invoke(main, ["eig", "pendulum.yaml", "--sensitivity", "--certify"])
    assert run.exit_code == 2
    assert "--sensitivity goes with none of" in run.output


def test_the_picture_has_a_panel_for_each_eigenvalue_and_the_longest_bar_first(tmp_path):
    figure = sensitivity_bars(load("whipple_bicycle.yaml").sensitivities(v=5), "")
    assert [len(panel.patches) for panel in figure.axes] == [8, 16, 8]  # a pair has two bars for each parameter
    assert [panel.get_yticklabels()[0].get_text() for panel in figure.axes] == ["x_S", "x_H", "w"]
    assert figure.axes[2].patches[0].get_width() == pytest.approx(0.01 * 1.02 * 21.1149432666, rel=1e-9)
    # 25 parameters move each eigenvalue; the picture and the table say what they leave out.
    found = load("whipple_bicycle.yaml").sensitivities(v=5)
    moving = sum(np.sum((np.abs(x.slopes) > x.errors) & (found.values != 0.0)) for x in found.derivatives)
    (text,) = (text.get_text() for text in figure.legends[0].get_texts() if "not drawn" in text.get_text())
    assert text == f"not drawn: {moving - 24} bars of less effect"
    arguments = ["eig", "pendulum.yaml", "--sensitivity", "--plot", "sensitivity", "--pictures", f"{tmp_path}/a"]
    assert CliRunner().invoke(main, arguments).exit_code == 0
    assert (tmp_path / "a-sensitivity.png").read_bytes().startswith(b"\x89PNG")
    run = CliRunner().invoke(main, ["eig", "pendulum.yaml", "--plot", "sensitivity"])
    assert run.exit_code == 2
    assert "give both" in run.output


def oscillators(seed, span, coupling):
    """Return a model of oscillators along x that push each other, its parameters, and names of the forces by place.

    Parameters
    ----------
    span : float
        Numbers are 10**-span to 10**span.
    coupling : float
        Of the first two, which are equal, relative to their stiffness; 0: they differ, as the others do.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 4))

    def number(low, high):
        return f"{10 ** rng.uniform(low, high):.6g}"

    values = {f"{x}{i}": number(-span, span) for i in range(n) for x in "mk"}
    values |= {f"c{i}": number(-3.0, 0.0) for i in range(n)}
    if coupling:
        values |= {f"{x}1": values[f"{x}0"] for x in "mkc"}
    terms = {i: f"-k{i}*b{i}.x - c{i}*rate(b{i}.x)" for i in range(n)}
    for i, j in itertools.permutations(range(n), 2):
        size = coupling * float(values["k0"]) if coupling and i + j == 1 else 0.3 * float(number(-span, span))
        values[f"e{i}{j}"] = f"{size * rng.choice([-1.0, 1.0]):.6g}"
        terms[i] += f" + e{i}{j}*b{j}.x"
    lines = ["mbstab: 1", "parameters:", *(f"  {name}: {value}" for name, value in values.items())]
    lines += ["bodies:", *(f"  b{i}: {{type: planar_point, mass: m{i}}}" for i in range(n))]
    lines += ["constraints:", *(f"  l{i}: {{holonomic: b{i}.y}}" for i in range(n))]
    lines += ["forces:", *(f"  f{i}: {{type: expression, on: {{b{i}.x: {terms[i]}}}}}" for i in range(n))]
    return "\n".join([*lines, "reference: {}", ""]), values, n


def derivatives_of_oscillators(values, n):
    """Return each eigenvalue and its derivatives by name, in 40 digits."""
    v = {name: mpmath.mpf(text) for name, text in values.items()}
    A, slopes = mpmath.zeros(2 * n), {name: mpmath.zeros(2 * n) for name in v}
    for i in range(n):
        A[i, n + i] = 1
        for name, column, sign in (
            *((f"{x}{i}", n * (x == "c") + i, -1) for x in "kc"), *((f"e{i}{j}", j, 1) for j in range(n) if j != i)
        ):  # fmt: skip
            A[n + i, column] += sign * v[name] / v[f"m{i}"]
            slopes[name][n + i, column] = sign / v[f"m{i}"]
        for column in range(2 * n):
            slopes[f"m{i}"][n + i, column] = -A[n + i, column] / v[f"m{i}"]
    found, left, right = mpmath.eig(A, left=True, right=True)
    for k, eigenvalue in enumerate(found):
        y, x = left[k, :], right[:, k]
        yield eigenvalue, {name: (y * slope * x)[0] / (y * x)[0] for name, slope in slopes.items()}


@pytest.mark.parametrize("seed", [*range(6), *(pytest.param(k, marks=pytest.mark.long) for k in range(6, 60))])
@pytest.mark.parametrize(("span", "coupling"), [(1.0, 0.0), (3.0, 0.0), (1.0, 1e-3), (3.0, 1e-7)])
def test_errors_of_derivatives_hold_also_beside_other_eigenvalues(seed, span, coupling):
    text, values, n = oscillators(seed, span, coupling)
    found = mbstab.loads(text).sensitivities()
    with mpmath.workdps(40):
        truth = list(derivatives_of_oscillators(values, n))
        for item in found.derivatives:
            value = mpmath.mpc(found.eigenvalue(item).value)
            slopes = min(truth, key=lambda pair: abs(pair[0] - value))[1] if not item.missing else {}
            for k, name in enumerate(found.parameters if slopes else ()):
                assert abs(mpmath.mpc(item.slopes[k]) - slopes[name]) <= item.errors[k] + 1e-40


def test_slopes_of_different_bodies_are_not_mixed():
    """A fast light mass beside a heavy one: the derivative by the heavy mass had 26 times the error that was told."""
    text = """mbstab: 1
parameters: {m0: 0.000597, m1: 0.0195}
bodies: {b0: {type: planar_point, mass: m0}, b1: {type: planar_point, mass: m1}}
constraints: {l0: {holonomic: b0.y}, l1: {holonomic: b1.y}}
states: {z: {rate: 0.918*b1.x - 1040*rate(b0.x)}}
forces:
  f0: {type: expression, on: {b0.x: 0.00489*b0.x + 132*b1.x + 4.5*rate(b0.x) + 226*z}}
  f1: {type: expression, on: {b1.x: 299*b0.x - 245*b1.x - 0.547*z}}
reference: {}
"""
    mechanism = mbstab.loads(text)
    found = mechanism.sensitivities()
    for k, name in enumerate(found.parameters):
        exact = differences(mechanism, name, 50)
        for item in found.derivatives:
            assert abs(item.slopes[k] - exact(found.eigenvalue(item).value)) <= item.errors[k]
