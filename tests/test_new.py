"""mbstab new: commented files with which own models begin."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
from mbstab.model.library import starts_folder

KINDS = sorted(path.stem for path in starts_folder().glob("*.yaml"))


def run(*words):
    return CliRunner().invoke(main, [*words])


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_kinds_are_listed():
    assert KINDS == ["controller", "planar", "robot", "rotor", "rotor_3d", "spatial", "vehicle"]
    lines = run("new").stdout.splitlines()
    assert [line.split()[0] for line in lines] == KINDS
    assert all(20 < len(line) <= 80 for line in lines)


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_file_runs_at_once(kind, here):
    made = run("new", kind, "own.yaml")
    assert (made.exit_code, made.stdout, made.stderr) == (0, "", "wrote own.yaml\n")
    text = (here / "own.yaml").read_text(encoding="utf-8")
    assert text.startswith("# yaml-language-server: $schema=mbstab.schema.json\n")
    assert text.count("#") > 8  # commented
    assert not re.search(rf"(?<!\w){kind}\.yaml", text)  # but rigid_rotor.yaml, say
    model = mbstab.load(here / "own.yaml")
    # Nothing is solved differently, and no warning is needed, but for the top: gyroscopic stability is not robust.
    answer = model.eig()
    assert answer.verdict in ("asymptotically stable", "asymptotically stable up to symmetry", "stable up to symmetry")
    assert len(answer.warnings) == (kind == "spatial")
    asked = re.findall(r"^#   mbstab (\w+) own\.yaml((?: \S+)*)", text, flags=re.M)
    assert ("eig", "") in asked
    ends = {"sweep": ["--points", "2", "--plot", "none"], "response": ["--points", "2"]}
    for command, options in asked:  # the range of the file, at its ends only
        found = run(command, "own.yaml", *options.split(), *ends.get(command, []))
        assert found.exit_code == 0, found.stderr


def test_the_new_rotor_whirls(here):
    """Unstable from sqrt(k/m) (1 + c_e/c_i), where forward whirl has the frequency sqrt(k/m); backward whirl decays."""
    run("new", "rotor")
    mechanism = mbstab.load(here / "rotor.yaml")
    (critical,) = mechanism.sweep("omega", np.linspace(100.0, 900.0, 9)).critical
    assert critical.value == pytest.approx(600.0, rel=1e-10)
    assert critical.frequency == pytest.approx(200.0, rel=1e-10)
    assert {e.whirl for e in mechanism.eig().eigenvalues if e.value.imag} == {"forward", "backward"}
    (growing,) = {e.whirl for e in mechanism.eig(omega=700).eigenvalues if e.value.real > 0}
    assert growing == "forward"


@pytest.mark.parametrize("speed", [0.0, 9000.0])  # rpm
def test_the_new_rotor_in_space_has_gyroscopic_moments(speed, here):
    """Shifts and tilts across the axis as complex numbers: (M s² + (C - i G) s + K) u = 0, and its conjugate."""
    run("new", "rotor_3d")
    m, i_t, i_p, a, b, k, c = 20.0, 0.3, 0.5, 0.15, 0.25, 2e6, 400.0
    shape = np.array([[2.0, b - a], [b - a, a * a + b * b]])
    mass, gyroscopic = np.diag([m, i_t]), np.diag([0.0, i_p * speed * np.pi / 30.0])
    inverse = np.linalg.inv(mass)
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-k * inverse @ shape, -inverse @ (c * shape - 1j * gyroscopic)]])
    own = np.linalg.eigvals(state)
    expected = np.concatenate([own, own.conj()])
    answer = mbstab.load(here / "rotor_3d.yaml").eig(Omega=speed)
    found = np.array([e.value for e in answer.eigenvalues if e.value != 0.0])
    assert len(found) == 8
    for value in found:
        assert np.min(np.abs(expected - value)) < 1e-9 * abs(value)


def test_the_name_is_that_of_the_kind_if_none_is_given(here):
    assert run("new", "rotor").stderr == "wrote rotor.yaml\n"
    (here / "folder").mkdir()
    assert run("new", "rotor", "folder").exit_code == 0
    assert (here / "folder" / "rotor.yaml").is_file()


def test_no_file_is_overwritten(here):
    (here / "rotor.yaml").write_text("mine", encoding="utf-8")
    answer = run("new", "rotor")
    assert answer.exit_code == 2
    assert "rotor.yaml exists already\nhint: name another FILE" in answer.stderr
    assert (here / "rotor.yaml").read_text(encoding="utf-8") == "mine"


def test_an_unknown_kind_is_refused_with_the_nearest_one(here):
    answer = run("new", "vehicel")
    assert answer.exit_code == 2
    assert "there is no kind 'vehicel' of model\nhint: did you mean 'vehicle'?" in answer.stderr
    assert "one of controller, planar," in run("new", "zzz").stderr
    assert list(here.iterdir()) == []


def test_output_is_the_same_as_a_file(here):
    made = run("new", "rotor", "-o", "own.yaml")
    assert (made.exit_code, made.stderr) == (0, "wrote own.yaml\n")
    assert (here / "own.yaml").read_text(encoding="utf-8") == run_file(here)
    assert run("new", "rotor", "a.yaml", "-o", "b.yaml").exit_code == 2
    assert "needs a KIND of model" in run("new", "-o", "c.yaml").stderr
    assert sorted(x.name for x in here.iterdir()) == ["own.yaml", "own2.yaml"]


def run_file(here):
    run("new", "rotor", "own2.yaml")
    return (here / "own2.yaml").read_text(encoding="utf-8").replace("own2.yaml", "own.yaml")
