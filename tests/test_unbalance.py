"""Unbalance responses against closed forms: the Jeffcott rotor, and a rigid rotor on two bearings."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from random_rotors import Rotor
from test_cli import run
from test_orders import HALF, MASS, MEETING, POLAR, ROTOR, TRANSVERSE

import mbstab
from mbstab.analysis.sweep import unbalance as module
from mbstab.analysis.sweep.unbalance import read_unbalances, unbalance
from mbstab.errors import NumericalError, UsageError
from mbstab.report.pictures.responses import unbalance_picture
from mbstab.report.pictures.scales import Axis

JEFFCOTT = """mbstab: 1
parameters: {n: {value: 10, unit: rad/s}, c: {value: 8, unit: N*s/m}}
bodies:
  disk: {type: planar, mass: 5, inertia: 0.2}
forces:
  right: {type: bearing, between: [disk, ground], stiffness: 4500, damping: c}
outputs: {u: disk.x, v: disk.y, speed: rate(disk.x)}
reference:
  coordinates: {disk: {x: 0, y: 0, theta: 0}}
  rates: {disk: {x: 0, y: 0, theta: n}}
"""


def test_the_jeffcott_rotor():
    """r = m e Ω²/(k - m Ω² + i c Ω), whirling with the unbalance: v follows u a quarter of a turn later."""
    speeds = np.array([5.0, 20.0, 30.0, 33.0, 200.0])
    found = unbalance(mbstab.loads(JEFFCOTT).model, "disk", "n", speeds)
    r = speeds**2 / (4500 - 5 * speeds**2 + 8j * speeds)
    np.testing.assert_allclose(found.values, [r, -1j * r, 1j * speeds * r], rtol=1e-12)
    assert found.outputs == ("u", "v", "speed")
    assert found.units[0] == "m/(kg*m)"
    # Without damping the critical speed √(k/m) has no bound.
    undamped = unbalance(mbstab.loads(JEFFCOTT).at(c=0).model, "disk", "n", np.array([29.9, 30.0]), ("v",))
    assert abs(undamped.values[0, 0]) == pytest.approx(29.9**2 / (4500 - 5 * 29.9**2), rel=1e-10)
    assert abs(undamped.values[0, 1]) > 1e12


@pytest.mark.parametrize("sense", [1, -1])
def test_a_rigid_rotor_on_two_unequal_bearings(sense):
    """Forward whirl r, φ: (K + iΩC - Ω² diag(m, I_d - I_p)) (r, φ) = Ω² (1, h), with the unbalance at one bearing."""
    text = ROTOR.replace("c: {value: 0", "c: {value: 500").replace("psi: Omega}", f"psi: {sense}*Omega}}")
    speeds = np.array([50.0, 135.0, 250.0, 400.0])
    found = unbalance(mbstab.loads(text).model, "rotor.A", "Omega", speeds, ("x", "y", "tilt"))
    for speed, values in zip(speeds, found.values.T, strict=True):
        a, b = 1e6 + 500j * speed, 1.3e6 + 500j * speed
        K = np.array([[a + b, (a - b) * HALF], [(a - b) * HALF, (a + b) * HALF**2]])
        r, tilt = np.linalg.solve(K - speed**2 * np.diag([MASS, TRANSVERSE - POLAR]), speed**2 * np.array([1.0, HALF]))
        np.testing.assert_allclose(values, [r, -1j * sense * r, tilt], rtol=1e-11)


def test_the_command_writes_and_draws_it(tmp_path):
    path = tmp_path / "rotor.yaml"
    path.write_text(JEFFCOTT)
    arguments = ("response", str(path), "--unbalance", "disk", "--speed", "n", "--from", "10", "--to", "60")
    result = run(*arguments, "--points", "6", "--plot", "unbalance", "--pictures", str(tmp_path / "a.svg"))
    assert result.exit_code == 0
    assert "From an unbalance at disk to u (m/(kg*m))" in result.stdout
    assert (tmp_path / "a-unbalance.svg").stat().st_size > 5000
    data = json.loads(run(*arguments, "--points", "2", "--measured", "v", "--format", "json").stdout)
    (output,) = data["outputs"]
    r = 3600 / (4500 - 5 * 3600 + 480j)
    np.testing.assert_allclose([output["real"][1], output["imag"][1]], [(-1j * r).real, (-1j * r).imag], rtol=1e-12)
    lines = run(*arguments, "--points", "2", "--format", "csv").stdout.splitlines()
    assert lines[0].startswith("n (rad/s),u real (m/(kg*m)),u imag (m/(kg*m)),u amplitude (m/(kg*m)),u phase (deg),")
    real, imag, amplitude, angle = map(float, lines[2].split(",")[1:5])
    assert complex(real, imag) == pytest.approx(amplitude * np.exp(1j * np.radians(angle)), rel=1e-12)
    assert len(lines) == 3


def test_the_axis_says_what_turns():
    found = unbalance(mbstab.loads(JEFFCOTT).model, "disk", "n", np.array([10.0, 20.0]))
    figure = unbalance_picture(found, "", Axis("n", "rpm", np.pi / 30.0, "spin"))
    assert figure.axes[1].get_xlabel() == "spin n (rpm)"
    assert figure.axes[1].get_xlim() == pytest.approx((10.0 * 30.0 / np.pi, 20.0 * 30.0 / np.pi))


def test_the_picture_says_what_is_unstable_and_in_which_units():
    found = unbalance(mbstab.loads(JEFFCOTT).model, "disk", "n", np.array([10.0, 20.0]))
    for unstable in (False, True):
        verdicts = ["stable", "unstable" if unstable else "stable"]
        figure = unbalance_picture(replace(found, verdicts=verdicts, units=["m"] * 3), "", Axis("n"))
        legend = [text.get_text() for text in figure.legends[0].get_texts()]
        assert ("unstable range" in legend) == unstable
        assert "u" in legend  # the unit, which all share, stands at the axis
    assert figure.axes[0].get_ylabel().split() == ["amplitude", "per", "unbalance", "(m)"]
    axes = unbalance_picture(found, "", Axis("n")).axes[0]
    assert " ".join(axes.get_ylabel().split()) == "amplitude per unbalance (each in its own unit)"


@pytest.mark.parametrize(("c", "points"), [(8.0, 5), (0.8, 30), (0.02, 7)])
@pytest.mark.parametrize("ends", [(10.0, 60.0), (60.0, 10.0), (40.0, 60.0)])
def test_curves_are_smooth_however_coarse_the_speeds_are(c, points, ends):
    """Between the points drawn amplitude and phase of the Jeffcott rotor are nearer to the line than its width."""
    found = unbalance(mbstab.loads(JEFFCOTT).at(c=c).model, "disk", "n", np.linspace(*ends, points), ("u",))
    panels = unbalance_picture(found, "", Axis("n")).axes
    (amplitude,), (angle,) = (panel.get_lines() for panel in panels)
    x, sizes = amplitude.get_data()
    speeds = np.unique(np.concatenate([np.linspace(*sorted(ends), 2000), 30.0 + c * np.linspace(-0.3, 0.3, 999)]))
    speeds = speeds[(speeds > min(ends)) & (speeds < max(ends))]
    exact = speeds**2 / (4500 - 5 * speeds**2 + 1j * c * speeds)
    drawn = np.interp(speeds, x, np.log(sizes))
    assert np.max(np.abs(drawn - np.log(np.abs(exact)))) < 0.01 * np.ptp(np.log(sizes))
    turns = np.interp(speeds, *angle.get_data()) - np.degrees(np.angle(exact))
    # Where the phase falls within less than a pixel, it is a vertical line.
    narrow = np.abs(speeds - 30.0) < 0.02
    assert np.max(np.abs((turns + 180.0) % 360.0 - 180.0)[~narrow]) < 0.02 * max(np.ptp(angle.get_ydata()), 1.0)


def test_speeds_count_in_the_unit_of_the_parameter_and_unstable_ones_are_marked(tmp_path):
    """Internal damping c_i: unstable above (1 + c/c_i) sqrt(k/m), here 60 rad/s; Jeffcott's amplitude is there, too."""
    text = JEFFCOTT.replace("n: {value: 10, unit: rad/s}", "n: {value: 100, unit: rpm}")
    inner = (
        "  inner: {type: expression, on: {disk.x: -8*(rate(disk.x) + n*disk.y), disk.y: -8*(rate(disk.y) - n*disk.x)}}"
    )
    path = tmp_path / "rotor.yaml"
    path.write_text(text.replace("outputs:", f"{inner}\noutputs:"))
    arguments = ("response", str(path), "--unbalance", "disk", "--speed", "n", "--measured", "u")
    arguments += ("--from", "500 rpm", "--to", "600", "--points", "3")
    result = run(*arguments, "--plot", "unbalance", "--pictures", str(tmp_path / "a.png"))
    assert result.exit_code == 0
    assert "n (rpm)" in result.stdout
    rows = [line.split() for line in result.stdout.splitlines() if line.strip().startswith(("500", "550", "600"))]
    assert [len(row) for row in rows] == [3, 3, 4]
    assert rows[-1][-1] == "unstable"
    assert "Unstable at 1 of 3 speeds" in result.stdout
    data = json.loads(run(*arguments, "--format", "json").stdout)
    np.testing.assert_allclose(data["speed"], np.array([500, 550, 600]) * np.pi / 30)
    assert data["verdicts"][:2] == [data["verdicts"][0]] * 2
    assert data["verdicts"][2] == "unstable"
    head, *_, line = run(*arguments, "--format", "csv").stdout.splitlines()
    assert head.startswith("n (rpm),")
    assert line.startswith("600.0,")
    assert line.endswith(",unstable")
    # The whirl stands still in the disk, where the inner damping has nothing to do.
    speed = data["speed"][2]
    r = speed**2 / (4500 - 5 * speed**2 + 8j * speed)
    assert complex(data["outputs"][0]["real"][2], data["outputs"][0]["imag"][2]) == pytest.approx(r, rel=1e-12)


@pytest.mark.parametrize("c", [8.0, 0.02, 1e-6])
@pytest.mark.parametrize("points", [2, 7, 40])
def test_the_peak_is_found_however_coarse_the_speeds_are(c, points):
    """r = Ω²/√((k - m Ω²)² + c² Ω²) is largest where Ω² = 2 k²/(2 m k - c²)."""
    k, m = 4500.0, 5.0
    w = 2 * k**2 / (2 * m * k - c**2)
    found = unbalance(mbstab.loads(JEFFCOTT).at(c=c).model, "disk", "n", np.linspace(60.0, 5.0, points), ("u", "v"))
    for peak in found.peaks:
        assert peak.inside
        assert peak.speed == pytest.approx(math.sqrt(w), rel=1e-6)
        assert abs(peak.value) == pytest.approx(w / math.hypot(k - m * w, c * math.sqrt(w)), rel=1e-6)


def test_a_peak_without_bound_or_at_an_end_is_told(tmp_path):
    text = JEFFCOTT.replace("c: {value: 8", "c: {value: 0")
    (peak,) = unbalance(mbstab.loads(text).model, "disk", "n", np.linspace(5.0, 60.0, 7), ("u",)).peaks
    assert not peak.bounded
    assert peak.speed == pytest.approx(30.0, rel=1e-12)
    path = tmp_path / "rotor.yaml"
    path.write_text(text)
    arguments = ("response", str(path), "--unbalance", "disk", "--speed", "n", "--measured", "u", "--from", "10")
    said = run(*arguments, "--to", "60", "--points", "20", "--plot", "unbalance", "--pictures", str(tmp_path / "a.svg"))
    assert said.exit_code == 0
    assert "of 20 speeds the first of each 2 and the last are shown; --format csv has all" in said.stdout
    assert "grows without bound at 30 rad/s" in said.stdout
    assert (
        "no peak inside of the range; largest: 0.16 at 20 rad/s, phase 0"
        in run(*arguments, "--to", "20", "--points", "14").stdout
    )
    data = json.loads(run(*arguments, "--to", "60", "--points", "7", "--format", "json").stdout)
    peak = data["outputs"][0]["peak"]
    assert peak.pop("error") < 1e-11
    assert peak == {"speed": pytest.approx(30.0), "real": None, "imag": None, "inside": True}


def test_an_undamped_motion_that_the_unbalance_does_not_reach_makes_no_peak():
    """Torsion of the disk against ground, 25 rad/s, is not damped; x and y have their peak at the critical speed."""
    twist = "  twist: {type: expression, on: {ring.theta: -62.5*ring.theta}}\noutputs:"
    text = JEFFCOTT.replace("outputs:", twist).replace(
        "inertia: 0.2}", "inertia: 0.2}\n  ring: {type: planar, mass: 1, inertia: 0.1}"
    )
    text = text.replace("coordinates: {", "coordinates: {ring: {x: 0, y: 0, theta: 0}, ")
    text += "joints: {pin: {type: revolute, between: [ring, ground]}}\n"
    (peak,) = unbalance(mbstab.loads(text).model, "disk", "n", np.linspace(5.0, 60.0, 7), ("u",)).peaks
    assert peak.bounded
    assert peak.speed == pytest.approx(30.02135611589204, rel=1e-6)


def test_verdicts_are_those_of_eig_where_a_rotor_becomes_unstable():
    text = JEFFCOTT.replace("c: {value: 8", "ci: {value: 5, unit: N*s/m}, c: {value: 8")
    text = text.replace("outputs:", "  shaft: {type: bearing, between: [ground, disk], damping: ci}\noutputs:")
    mechanism, speeds = mbstab.loads(text), np.array([20.0, 77.9, 78.1, 200.0])
    found = unbalance(mechanism.model, "disk", "n", speeds)
    assert list(found.verdicts) == [mechanism.eig(n=x).verdict for x in speeds]
    # (1 + c/c_i) √(k/m) = 78 rad/s
    assert found.unstable.tolist() == [False, False, True, True]


@pytest.mark.parametrize(
    ("point", "speed", "message"),
    [
        ("dsk", "n", "did you mean 'disk'"),
        ("disk.rim", "n", "there is no point of 'disk' 'rim'"),
        ("disk", "c", "spins with 10 rad/s"),
        ("disk", "m", "has no parameter 'm'"),
    ],
)
def test_wrong_questions_are_refused(point, speed, message):
    with pytest.raises(UsageError, match=message):
        unbalance(mbstab.loads(JEFFCOTT).model, point, speed, np.array([5.0]))


def test_a_speed_that_is_not_that_of_the_body_is_told_in_its_unit():
    text = JEFFCOTT.replace("n: {value: 10, unit: rad/s}", "n: {value: 500, unit: rpm}").replace(
        "theta: n", "theta: 2*n"
    )
    with pytest.raises(UsageError, match="with n = 300 rpm 'disk' spins with 600 rpm"):
        unbalance(mbstab.loads(text).model, "disk", "n", np.array([10.0 * np.pi]))


def test_a_turning_frame_is_refused():
    odd = ROTOR.replace(f"[{TRANSVERSE}, {TRANSVERSE}", f"[{TRANSVERSE}, {1.01 * TRANSVERSE}")
    odd = odd.replace("reference:\n", "reference:\n  steady: {axis: z, rate: Omega}\n")
    with pytest.raises((NumericalError, UsageError)) as stop:
        unbalance(mbstab.loads(odd).model, "rotor.A", "Omega", np.array([50.0]))
    assert "turning frame" in str(stop.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--unbalance", "disk"), "go together"),
        (("--unbalance", "disk", "--speed", "n"), "--from is missing"),
        (("--unbalance", "disk", "--speed", "n", "--step", "1"), "goes with none of"),
        (("--unbalance", "disk", "--speed", "n", "--from", "0", "--to", "60"), "n goes from 0 to 60 rad/s\nhint: give"),
        (("--unbalance", "disk", "--speed", "n", "--from", "1", "--to", "2", "--plot", "bode"), "drawn as unbalance"),
    ],
)
def test_wrong_options_are_refused(arguments, message, tmp_path):
    path = tmp_path / "rotor.yaml"
    path.write_text(JEFFCOTT)
    result = run("response", str(path), *arguments)
    assert result.exit_code == 2
    assert message in result.stderr


def test_every_peak_of_at_least_a_hundredth_of_the_largest_is_told(tmp_path):
    """With 4500 N/m along x and 9000 N/m along y, x + y answers with Ω²/(k_x - m Ω² + icΩ) - iΩ²/(k_y - m Ω² + icΩ)."""
    stiffer = JEFFCOTT.replace(
        "outputs: {", "  more: {type: expression, on: {disk.y: -4500*disk.y}}\noutputs: {w: disk.x + disk.y, "
    )
    found = unbalance(mbstab.loads(stiffer).model, "disk", "n", np.linspace(5.0, 60.0, 56), ("w", "u"))
    speeds = np.linspace(5.0, 60.0, 1_000_001)
    exact = abs(sum(f * speeds**2 / (k - 5 * speeds**2 + 8j * speeds) for f, k in ((1, 4500), (-1j, 9000))))
    tops = speeds[1:-1][(exact[1:-1] > exact[:-2]) & (exact[1:-1] > exact[2:])]
    assert len(tops) == 2
    peaks = sorted([found.peaks[0], *found.further[0]], key=lambda peak: peak.speed)
    assert [peak.speed for peak in peaks] == pytest.approx(tops, abs=1e-3)
    assert found.further[1] == ()
    path = tmp_path / "rotor.yaml"
    path.write_text(stiffer, encoding="utf-8")
    words = (
        "response",
        str(path),
        "--unbalance",
        "disk",
        "--speed",
        "n",
        "--measured",
        "w",
        "--from",
        "5",
        "--to",
        "60",
    )
    assert "further peak: " in run(*words).stdout
    (other,) = json.loads(run(*words, "--format", "json").stdout)["outputs"][0]["further_peaks"]
    assert other["speed"] == pytest.approx(found.further[0][0].speed, abs=1e-3)


@pytest.mark.parametrize(("n1", "n2", "points"), [(1030, 1060, 11), (1005, 1012, 11), (520, 540, 12), (1460, 1490, 11)])
def test_the_largest_of_narrow_peaks_between_two_speeds_is_told(n1, n2, points):
    """Amplitudes n²/|k - n² + 0.02 i n| along x are about n/0.02 at both resonances."""
    found = unbalance(mbstab.loads(MEETING).at(n1=n1, n2=n2).model, "r", "n", np.linspace(500.0, 1500.0, points))
    speeds = np.linspace(n1 - 5.0, n2 + 5.0, 1_000_001)
    exact = speeds**2 / abs(0.5 * (speeds - n1) * (speeds - n2) + 0.02j * speeds)
    tops = np.flatnonzero((exact[1:-1] > exact[:-2]) & (exact[1:-1] > exact[2:])) + 1
    peaks = [*found.further[0], found.peaks[0]]
    assert [x.speed for x in peaks] == pytest.approx(speeds[tops], rel=1e-6)
    assert [abs(x.value) for x in peaks] == pytest.approx(exact[tops], rel=1e-6)


def test_a_narrow_peak_where_a_frequency_only_comes_near_the_spin_is_found():
    """k - n² = 0.5 (n - 1030)² + 1 is smallest at 1030, between points."""
    text = MEETING.replace("0.5*(n - n1)*(n - n2)", "0.5*(n - n1)**2 + n2*n2/1123600")
    speeds = np.linspace(500.0, 1500.0, 1_000_001)
    exact = speeds**2 / abs(0.5 * (speeds - 1030) ** 2 + 1 + 0.02j * speeds)
    (peak,) = unbalance(mbstab.loads(text).model, "r", "n", np.linspace(500.0, 1500.0, 11)).peaks
    assert abs(peak.value) == pytest.approx(exact.max(), rel=1e-7)


def test_phases_are_numbers_within_half_a_turn(tmp_path):
    """Far above the critical speed v is 90 degrees behind u, which is half a turn behind: at 90, not at -270."""
    (tmp_path / "rotor.yaml").write_text(JEFFCOTT)
    arguments = ("response", str(tmp_path / "rotor.yaml"), "--unbalance", "disk", "--speed", "n", "--points", "41")
    lines = run(*arguments, "--from", "10", "--to", "6000", "--format", "csv").stdout.splitlines()
    columns = [k for k, head in enumerate(lines[0].split(",")) if head.endswith("phase (deg)")]
    for line in lines[1:]:
        cells = line.split(",")
        speed = float(cells[0])
        u = speed**2 / (4500 - 5 * speed**2 + 8j * speed)
        for k, z in zip(columns, (u, -1j * u, 1j * speed * u), strict=True):
            assert -180.0 < float(cells[k]) <= 180.0
            assert float(cells[k]) == pytest.approx(np.degrees(np.angle(z)), abs=1e-6)
    text = run(*arguments, "--from", "10", "--to", "6000", "--measured", "v").stdout
    last = next(x for x in map(str.split, text.splitlines()) if x[:1] == ["6000"])
    assert float(last[2]) == pytest.approx(90.0, abs=0.1)


def test_the_equations_are_formed_at_a_few_speeds_whatever_their_number(monkeypatch):
    formed = []
    whole = module.unreduced
    monkeypatch.setattr(module, "unreduced", lambda linear: formed.append(linear) or whole(linear))
    for points in (5, 60):
        unbalance(mbstab.loads(ROTOR).model, "rotor.A", "Omega", np.linspace(50.0, 400.0, points))
        assert len(formed) <= 5
        formed.clear()


def unbounded(peaks):
    return [peak for peak in peaks if not peak.bounded]


@pytest.mark.parametrize("points", [2, 5, 20])
def test_every_critical_speed_without_damping_is_told_once(points):
    """Speeds of a rotor between unlike bearings whose four modes are coupled, from its determinant."""
    bearings = [(z, 2e6, 1.6e6, 0.0, 0.0, 0.0) for z in (-0.15, 0.25)]
    rotor = Rotor(20.0, 0.3, 0.5, 0.0, 0.0, bearings, sags=False)
    speeds, reached = rotor.poles
    assert reached.all()
    found = unbalance(mbstab.loads(rotor.text).model, "rotor", "n", np.linspace(60.0, 800.0, points))
    for largest, further in zip(found.peaks, found.further, strict=True):
        peaks = unbounded((largest, *further))
        assert [peak.speed for peak in peaks] == pytest.approx(speeds, rel=1e-11)
        assert all(abs(peak.speed - x) <= peak.error for peak, x in zip(peaks, speeds, strict=True))


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", [2, 12, 13, 21, *(pytest.param(x, marks=pytest.mark.long) for x in range(100, 300))])
def test_random_rotors(seed):
    """Undamped critical speeds from the determinant and by the sweep; damped amplitudes from the equations by hand."""
    rotor = Rotor.random(seed)
    (P0, _, P2), _ = rotor.polynomial
    sizes = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(P2, P0))))
    model = mbstab.loads(rotor.text)
    for points in (2, 7):
        speeds = np.linspace(0.31 * min(sizes), min(1.17 * max(sizes), 20.0 * min(sizes)), points)
        found = model.unbalance("rotor.U", "n", speeds)
        told = [unbounded((peak, *more)) for peak, more in zip(found.peaks, found.further, strict=True)]
        if rotor.damped:
            assert not any(told)
            if not rotor.sags:
                np.testing.assert_allclose(found.values, rotor.amplitudes(speeds), rtol=1e-8)
                sampled = abs(rotor.amplitudes(np.linspace(speeds[0], speeds[-1], 50_001)))
                assert all(
                    abs(p.value) >= (1 - 1e-9) * y for p, y in zip(found.peaks, sampled.max(axis=1), strict=True)
                )
            continue
        crossings = np.array(
            [x.value for x in model.sweep("n", np.linspace(*speeds[[0, -1]], 7), orders=(1,)).crossings]
        )
        each = {peak.speed: peak.error for own in told for peak in own}
        assert all(np.min(abs(crossings - x)) <= error + 1e-10 * x for x, error in each.items())
        if not rotor.sags:
            inside = [x for x, y in zip(*rotor.poles, strict=True) if y and speeds[0] < x < speeds[-1]]
            assert sorted(each) == pytest.approx(inside, rel=1e-9)


def test_unbalances_in_several_planes_act_together(tmp_path):
    """Forward whirl r, tilt as of one unbalance, with the sum of forces and of moments."""
    text = ROTOR.replace("c: {value: 0", "c: {value: 500")
    speeds, amounts = np.array([50.0, 135.0, 400.0]), (2e-5, 3e-5 * np.exp(1j * np.radians(120.0)))
    given = read_unbalances(("rotor.A=2e-5", "rotor.B=30 g*mm@120"))
    found = mbstab.loads(text).unbalance(given, "Omega", speeds, ("x", "tilt"))
    assert found.units == ("m", "rad")
    for speed, values in zip(speeds, found.values.T, strict=True):
        a, b = 1e6 + 500j * speed, 1.3e6 + 500j * speed
        K = np.array([[a + b, (a - b) * HALF], [(a - b) * HALF, (a + b) * HALF**2]])
        force = np.array([sum(amounts), (amounts[0] - amounts[1]) * HALF])
        np.testing.assert_allclose(
            values, speed**2 * np.linalg.solve(K - speed**2 * np.diag([MASS, TRANSVERSE - POLAR]), force), rtol=1e-11
        )
    (tmp_path / "rotor.yaml").write_text(text)
    words = (
        "response",
        str(tmp_path / "rotor.yaml"),
        "--speed",
        "Omega",
        "--from",
        "50",
        "--to",
        "400",
        "--points",
        "3",
    )
    said = run(*words, "--unbalance", "rotor.A=2e-5", "--unbalance", "rotor.B=3e-5@120", "--measured", "x")
    assert "unbalances at rotor.A (2e-05 kg m), rotor.B (3e-05 kg m at 120°) to x (m)" in " ".join(said.stdout.split())
    for wrong, message in (
        (("rotor.A", "rotor.B"), "POINT=SIZE@PHASE"),
        (("rotor.A=2 kg",), "kg is not a unit like kg*m"),
        (("rotor.A=2@3 kg",), "kg is not a unit like deg"),
    ):
        refused = run(*words, *(word for text in wrong for word in ("--unbalance", text)))
        assert refused.exit_code == 2
        assert message in refused.stderr


def test_a_stiffness_with_corners_is_followed():
    """A stiffness that is the same at both ends and in the middle, and higher only between two other speeds."""
    bump = "tables: {bump: {x: [5, 12, 14, 16, 60], y: [4500, 4500, 9000, 4500, 4500]}}"
    text = JEFFCOTT.replace("stiffness: 4500", "stiffness: 'linear(n, bump)'").replace("bodies:", f"{bump}\nbodies:", 1)
    speeds = np.array([6.0, 13.0, 14.5, 20.0, 50.0])
    found = unbalance(mbstab.loads(text).model, "disk", "n", speeds, ("u",))
    stiffness = np.interp(speeds, [5, 12, 14, 16, 60], [4500, 4500, 9000, 4500, 4500])
    np.testing.assert_allclose(found.values[0], speeds**2 / (stiffness - 5 * speeds**2 + 8j * speeds), rtol=1e-11)


def test_tables_say_which_rows_they_leave_out(tmp_path):
    (tmp_path / "rotor.yaml").write_text(JEFFCOTT)
    words = ("response", str(tmp_path / "rotor.yaml"), "--unbalance", "disk", "--speed", "n", "--measured", "u")
    lines = run(*words, "--from", "10", "--to", "36", "--points", "27").stdout.splitlines()
    assert [line.split()[0] for line in lines if line.strip()[:1].isdigit()] == [*map(str, range(10, 35, 3)), "36"]
    assert "of 27 speeds the first of each 3 and the last are shown; --format csv has all" in lines


BESIDE = """
mbstab: 1
parameters: {Omega: {value: 30, unit: rad/s}, d: 0}
ground: {points: {upper: [0, 0, 0.1], lower: [0, 0, -0.2]}}
bodies:
  disk:
    type: spatial
    mass: 2
    inertia: [0.02, 0.02, 0.03]
    center_of_mass: [0, 0, d]
    points: {upper: [0, 0, 0.1], lower: [0, 0, -0.2], axis: [0, 0, 0.07], rim: [0.06, -0.08, 0.07]}
forces:
  b1: {type: rotor_bearing, between: [disk.upper, ground.upper], kxx: 1e3, kyy: 2500, cxx: 8, cyy: 12, kxy: 90}
  b2: {type: rotor_bearing, between: [disk.lower, ground.lower], kxx: 1500, kyy: 2500, cxx: 8, cyy: 24}
constraints: {stay: {holonomic: disk.z}}
drives: {spin: {type: coordinate, coordinate: disk.psi, velocity: Omega}}
outputs: {x: x(disk.upper), tilt: disk.theta}
reference: {rates: {disk: {psi: Omega}}}
"""


@pytest.mark.parametrize("d", [0.0, 0.05])
def test_of_a_point_beside_the_spin_axis_its_foot_counts(d):
    mechanism, speeds = mbstab.loads(BESIDE).at(d=d), np.array([10.0, 29.0, 80.0])
    found = [mechanism.unbalance({f"disk.{point}": 1e-4j}, "Omega", speeds).values for point in ("axis", "rim")]
    np.testing.assert_allclose(*found, rtol=1e-12)
