"""The command line: answers on stdout, the rest on stderr, exit codes, files that appear whole."""

import csv
import io
import json
import math
import os
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from children import child
from click.testing import CliRunner

from mbstab.analysis.linear.methods import METHODS
from mbstab.cli import main

UNSTABLE = """\
mbstab: 1
parameters: {k: 1}
bodies:
  cart: {type: planar_point, mass: 1}
joints:
  rail: {type: prismatic, between: [cart, ground], axis: x}
"""


def run(*arguments):
    return CliRunner().invoke(main, list(arguments))


def answer(*arguments):
    result = run("eig", *arguments, "--format", "json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def test_json_has_the_keys_scripts_rely_on():
    data = answer("pendulum.yaml")
    assert data["verdict"] == "stable"
    assert (data["modulo"], data["in_place"]) == ({"symmetries": [], "family": []}, True)
    assert data["reason"] == data["reasons"][0]
    assert data["reason"].startswith("the energy has a strict minimum")
    assert data["evidence"] in ("structural", "enclosed", "numerical")
    assert data["warnings"] == []
    assert [set(e) >= {"real", "imag", "kind"} for e in data["eigenvalues"]] == [True, True]
    assert data["counts"]["expected"] == data["counts"]["found"] == 2
    assert data["parameters"]["L"] == {"value": 0.2, "unit": "m", "si": 0.2}
    assert not {"neutral_chains", "symmetries"} & set(data)


def test_json_says_up_to_what_a_verdict_holds():
    data = answer("chaplygin_sleigh.yaml")
    assert (data["verdict"], data["in_place"]) == ("asymptotically stable up to symmetry", False)
    assert set(data["modulo"]["symmetries"]) == {"sleigh.x", "sleigh.y", "rotation in the plane"}
    assert data["modulo"]["family"] == ["speed"]


def test_json_keeps_every_digit():
    value = answer("pendulum.yaml")["eigenvalues"][0]["imag"]
    assert abs(value - math.sqrt(3 * 9.81 / 0.8)) <= 1e-15 * value


def test_csv_is_one_row_per_eigenvalue():
    rows = list(csv.reader(io.StringIO(run("eig", "rolling_torus.yaml", "--format", "csv").stdout)))
    assert rows[0][:3] == ["real (1/s)", "imag (1/s)", "kind"]
    assert len(rows) == 1 + 8
    assert sum(row[2] == "neutral" for row in rows) == 6


def test_the_terminal_answer_fits_eighty_columns():
    for model in ("pendulum", "top", "rolling_disk", "slider_crank", "wheeled_inverted_pendulum", "free_rigid_body"):
        assert max(map(len, run("eig", model).stdout.splitlines())) <= 80


def test_an_example_is_used_from_anywhere_and_stderr_says_which(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("eig", "pendulum.yaml")
    assert result.exit_code == 0
    assert "using the example model" in result.stderr
    assert "using" not in result.stdout


def test_a_file_here_wins_over_an_example(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pendulum.yaml").write_text("mbstab: 1\nbodies: {b: {type: planar_point, mass: 1}}\n", encoding="utf-8")
    result = run("eig", "pendulum.yaml")
    assert "example" not in result.stderr
    assert "neutral, 4" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("eig", "pendulum.yaml"), 0, ""),
        (("eig", "trailer.yaml", "--set", "v=-1"), 0, ""),
        (("eig", "trailer.yaml", "--require", "stable"), 0, ""),
        (("eig", "trailer.yaml", "--set", "v=-1", "--require", "stable"), 3, "required: stable, found: unstable"),
        (("eig", "trailer.yaml", "--require", "asymptotic"), 0, ""),
        (("eig", "pendulum.yaml", "--require", "stable"), 0, ""),
        (("eig", "pendulum.yaml", "--require", "asymptotic"), 3, "required: asymptotic, found: stable: the energy has"),
        (("eig", "whipple_bicycle.yaml", "--require", "asymptotic"), 0, ""),
        (("eig", "rolling_torus.yaml", "--require", "stable"), 0, ""),
        (("eig", "top.yaml", "--require", "stable"), 3, "required: stable, found: marginally stable: 4 eigen"),
        (("eig", "top.yaml", "--require", "marginal"), 0, ""),
        (("eig", "rolling_disk.yaml", "--require", "marginal"), 3, "required: marginal, found: undecided: "),
        (("eig", "nothing.yaml"), 2, "no such file"),
        (("eig", "pendulun.yaml"), 2, "did you mean 'pendulum'?"),
        (("eig", "pendulum.yaml", "--set", "LL=1"), 2, "has no parameter 'LL'\nhint: did you mean 'L'?"),
        (("eig", "pendulum.yaml", "--set", "L"), 2, "write NAME=VALUE, such as --set L=0.5"),
        (("schema", "steady"), 2, "did you mean 'reference.steady'?"),
        (("eig", "pendulum.yaml", "--set", "L=1", "--set", "L=2"), 2, "given twice"),
        (("eig", "pendulum.yaml", "--set", "L=nan"), 2, "'nan' is not a number"),
        (("eig", "pendulum.yaml", "--set", "L=1e300**2"), 2, "no value here"),
        (("eig", "pendulum.yaml", "--set", "m=-1"), 2, "bodies.rod.mass: mass must not be negative, got -1 kg"),
        (("eig", "pendulum.yaml", "--method", "qz"), 2, "--method: 'qz' is none of nullspace, "),
        (("linearize", "pendulum.yaml", "--format", "npz"), 2, "is binary: name a file with --output"),
        (("linearize", "pendulum.yaml", "--symbolic", "--format", "csv"), 2, "goes with the formats table and latex"),
        (("linearize", "pendulum.yaml", "--symbolic", "--set", "L=1"), 2, "has no effect"),
        (("models", "show", "nothing"), 2, "no such file"),
        (("fly",), 2, "no such command 'fly'"),
        (("--", "--symbolic"), 2, "error: no such option '--symbolic'"),
    ],
    ids=lambda x: " ".join(x) if isinstance(x, tuple) else None,
)
def test_exit_codes_and_messages(arguments, code, message):
    result = run(*arguments)
    assert result.exit_code == code
    assert message in result.stderr
    if code in (1, 2):
        assert result.stdout == ""


def test_a_wrong_file_shows_all_problems_with_their_places(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(
        "mbstab: 1\nbodies:\n  arm:\n    type: planar\n    masss: 1.5\n    mass: -1\n    inertia: 1\n", encoding="utf-8"
    )
    result = run("check", str(path))
    assert result.exit_code == 2
    assert f"{path}:5:5: bodies.arm: unknown key 'masss'" in result.stderr
    assert "hint: did you mean 'mass'?" in result.stderr
    assert " 5 |     masss: 1.5\n   |     ^" in result.stderr


def test_an_output_file_appears_whole_or_not_at_all(tmp_path):
    goal = tmp_path / "answer.json"
    assert run("eig", "pendulum.yaml", "--format", "json", "-o", str(goal)).exit_code == 0
    assert json.loads(goal.read_text(encoding="utf-8"))["verdict"] == "stable"
    assert os.listdir(tmp_path) == ["answer.json"]
    before = goal.read_text(encoding="utf-8")
    assert run("eig", "pendulum.yaml", "--set", "m=-1", "-o", str(goal)).exit_code == 2
    assert goal.read_text(encoding="utf-8") == before
    missing = run("eig", "pendulum.yaml", "-o", str(tmp_path / "no" / "folder.json"))
    assert missing.exit_code == 2
    assert "cannot be written" in missing.stderr


@pytest.mark.parametrize("form", ["equations", "composite", "pencil", "state-space"])
def test_linearize_prints_each_form(form):
    result = run("linearize", "wheeled_inverted_pendulum.yaml", "--form", form)
    assert result.exit_code == 0
    assert "×" in result.stdout


def test_linearize_json_npz_mat_and_csv_hold_the_same_numbers(tmp_path):
    from scipy.io import loadmat

    data = json.loads(run("linearize", "trailer.yaml", "--format", "json").stdout)
    for kind in ("npz", "mat"):
        goal = tmp_path / f"m.{kind}"
        assert run("linearize", "trailer.yaml", "--format", kind, "-o", str(goal)).exit_code == 0
        arrays = np.load(goal) if kind == "npz" else loadmat(goal)
        for name in ("M", "K", "C_q", "D_u", "D_q"):
            np.testing.assert_allclose(
                np.asarray(arrays[name], dtype=float), np.array(data["equations"][name]), rtol=0, atol=0
            )
    rows = list(csv.DictReader(io.StringIO(run("linearize", "trailer.yaml", "--format", "csv").stdout)))
    entries = {
        (r["matrix"], int(r["row"]) - 1, int(r["column"]) - 1): float(r["value"])
        for r in rows
        if r["form"] == "equations"
    }
    assert entries[("D_q", 0, 2)] == data["equations"]["D_q"][0][2] == -10.0


def test_the_state_space_has_the_eigenvalues_and_maps_back():
    data = json.loads(run("linearize", "slider_crank.yaml", "--format", "json").stdout)
    A = np.array(data["state-space"]["A"])
    found = np.linalg.eigvals(A)
    expected = answer("slider_crank.yaml")["eigenvalues"]
    assert min(abs(found - complex(expected[0]["real"], expected[0]["imag"]))) < 1e-12 * abs(found[0])
    to_q, to_u = np.array(data["state-space"]["to_coordinates"]), np.array(data["state-space"]["to_rates"])
    np.testing.assert_allclose(np.array(data["equations"]["C_q"]) @ to_q, 0, atol=1e-13)
    # The maps agree: Δu is the rate of Δq along y' = A y.
    np.testing.assert_allclose(to_q @ A, to_u, atol=1e-12)


def test_symbolic_blocks_of_the_pendulum_are_equations_80_to_82():
    text = run("linearize", "pendulum.yaml", "--symbolic").stdout
    assert "L⋅(λ₁⋅cos(θ) + λ₂⋅sin(θ))" in text
    assert "R_11 = O  (3 × 3)" in text
    assert "⎣L⋅sin(θ)  -L⋅cos(θ)⎦" in text


def test_wide_symbolic_blocks_are_continued_within_80_columns():
    text = run("linearize", "slider_crank.yaml", "--symbolic").stdout
    assert max(map(len, text.splitlines())) <= 80
    assert "↪" in text
    latex = run("linearize", "slider_crank.yaml", "--symbolic", "--format", "latex").stdout
    assert "↪" not in latex


def test_symbolic_blocks_of_the_wheeled_pendulum_are_equations_102_to_104():
    import sympy

    from mbstab import load

    blocks = load("wheeled_inverted_pendulum.yaml").symbolic().blocks
    m_d, I_d, m_p, I_p, R, L = sympy.symbols("m_d I_d m_p I_p R_d L_p", real=True)
    theta = sympy.Symbol("theta_pendulum", real=True)
    lam = [sympy.Symbol(f"lambda_{i}", real=True) for i in (1, 2, 3)]
    s, c = sympy.sin(theta), sympy.cos(theta)
    assert blocks["M_11"] == sympy.diag(m_d, m_d, I_d, m_p, m_p, I_p)
    assert blocks["R_11"].is_zero_matrix
    assert blocks["R_21"] == sympy.Matrix([[0] * 6] * 3 + [[1, 0, R, 0, 0, 0]])
    stiffness = sympy.zeros(6, 6)
    # The print has this entry in the column of y_p; the derivative belongs to theta_p.
    stiffness[5, 5] = -L * (lam[1] * c + lam[2] * s)
    assert sympy.simplify(blocks["K_11"] - stiffness).is_zero_matrix
    constraint = sympy.Matrix([[0, 1, 0, 0, 0, 0], [1, 0, 0, -1, 0, -L * s], [0, 1, 0, 0, -1, L * c], [0] * 6])
    assert blocks["K_21"] == constraint
    assert blocks["K_12"] == sympy.Matrix([*constraint[:3, :].tolist(), [1, 0, R, 0, 0, 0]]).T


def test_latex_is_equations_with_the_names_of_the_paper():
    text = run("linearize", "pendulum.yaml", "--symbolic", "--format", "latex").stdout
    assert r"\bar{\mathbf{K}}_{1,1} = \left[\begin{matrix}0 & 0 & 0\\0 & 0 & 0\\0 & 0 & L \left(" in text
    assert r"\bar{\mathbf{R}}_{1,1} = \mathbf{O}" in text


def test_models_can_be_listed_shown_and_copied(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    listed = run("models", "list").stdout
    assert "rolling_disk.yaml" in listed
    assert run("models", "show", "top").stdout.startswith("mbstab: 1\n")
    assert run("models", "copy", "top.yaml").exit_code == 0
    assert (tmp_path / "top.yaml").is_file()
    again = run("models", "copy", "top.yaml")
    assert again.exit_code == 2
    assert "exists already" in again.stderr


def test_mbstab_test_says_what_fails(tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text(
        run("models", "show", "pendulum").stdout.replace("sqrt(3*g/(4*L))", "sqrt(3*g/(4*L))*(1 + 1e-9)"),
        encoding="utf-8",
    )
    result = run("test", str(path))
    assert result.exit_code == 3
    assert "largest relative difference 1.0e-09" in " ".join(result.stdout.split())
    assert "2 passed, 1 failed" in result.stdout
    assert run("test", "pendulum.yaml", "-q").stdout == "3 passed, 0 failed\n"


def test_schema_is_json():
    assert json.loads(run("schema").stdout)["title"] == "mbstab model"


def test_schema_of_a_section_is_text_for_people():
    text = run("schema", "joints").stdout
    assert "revolute: turns about an axis (spatial scenes)" in text
    assert max(map(len, text.splitlines())) <= 80
    only = run("schema", "joints.screw").stdout
    assert "lead: advance in one turn" in only
    assert "revolute" not in only
    outputs = run("schema", "outputs").stdout
    assert "what is measured" in outputs
    assert "angle(joint)" in outputs
    assert "did you mean 'outputs'?" in run("schema", "output").stderr
    assert "did you mean 'joints'?" in run("schema", "joint").stderr
    assert "did you mean 'revolute'?" in run("schema", "joints.revolut").stderr
    assert run("schema", "joint").exit_code == run("schema", "joints.revolut").exit_code == 2


def test_check_says_what_a_scene_consists_of():
    result = run("check", "four_bar.yaml")
    assert "degrees of freedom  1" in result.stdout
    data = json.loads(run("check", "four_bar.yaml", "--format", "json").stdout)
    assert data["degrees_of_freedom"] == 1
    assert data["constraints"][0] == {"name": "A", "type": "revolute joint", "holonomic": 2, "nonholonomic": 0}


def test_check_names_what_is_not_needed():
    result = run("check", "pendulum.yaml", "--set", "g=0")
    assert result.exit_code == 0
    text = run("models", "show", "pendulum").stdout
    assert "is not used" not in text


def test_the_paper_method_counts_and_explains_its_undefined_pairs():
    result = run("eig", "wheeled_inverted_pendulum.yaml", "--method", "paper")
    assert "4 pairs 0/0" in result.stdout
    assert "singular for every s" in result.stdout


def test_the_help_lists_every_method_with_what_it_does():
    text = " ".join(run("eig", "--help").stdout.replace("-\n", "-").split()).replace("- ", "-")
    for name, method in METHODS.items():
        assert f"{name}: {method.description}" in text


def test_a_standard_technique_counts_and_explains_its_extra_eigenvalues():
    result = run("eig", "wheeled_inverted_pendulum.yaml", "--method", "udwadia-kalaba")
    text = " ".join(result.stdout.replace("-\n  ", "-").split())
    assert "5 expected, 5 found, 3 of them neutral; method udwadia-kalaba" in text
    assert "the method also returned 7 eigenvalues of constraint drift, two for each independent" in text
    assert "their exact values are 0, the largest error is" in text
    counts = json.loads(
        run("eig", "four_bar.yaml", "--method", "embedding", "--format", "json").stdout,
    )["counts"]
    assert counts["extra"] == 16
    assert 0.0 <= counts["extra_error"] < 1e-5


def test_dependent_rows_fail_a_technique_that_cannot_have_them():
    result = run("eig", "bricard.yaml", "--method", "projection")
    assert result.exit_code == 1
    assert "needs independent constraint rows, but 30 rows have rank 29: joint 'hinge_5'" in result.stderr
    assert "--method udwadia-kalaba" in result.stderr


def test_output_without_colour_and_without_a_terminal_is_the_same():
    environment = {**os.environ, "NO_COLOR": "1", "TERM": "dumb", "COLUMNS": "40"}
    piped = subprocess.run(
        [sys.executable, "-m", "mbstab", "eig", "top"], capture_output=True, encoding="utf-8", env=environment
    )
    assert piped.stdout == run("eig", "top").stdout


def test_what_is_required_is_an_order_of_verdicts():
    from mbstab.model.words import REQUIRED, UNDECIDED, UNSTABLE, WORDS

    asymptotic, stable, marginal = (set(REQUIRED[x]) for x in ("asymptotic", "stable", "marginal"))
    assert asymptotic < stable < marginal
    assert marginal == set(WORDS) - {UNSTABLE, UNDECIDED}


@pytest.mark.parametrize(
    "arguments",
    [
        ("eig", "{m}", "--format", "json", "-o", "{m}"),
        ("eig", "{m}", "--format", "json", "-o", "{link}"),
        ("check", "{json}", "-o", "{json}"),
        ("simulate", "{gif}", "--to", "0.1", "--animate", "{gif}"),
        ("simulate", "{m}", "--to", "0.1", "--format", "csv", "-o", "{gif}", "--animate", "{gif}"),
        ("simulate", "{picture}", "--to", "0.1", "--plot", "rod.theta", "--pictures", "{stem}"),
        ("sweep", "{map}", "--param", "L", "--from", "1", "--to", "2", "--points", "3", "--pictures", "{stem}"),
        ("compare", "{error}", "--plot", "error", "--pictures", "{stem}"),
        ("compare", "{m}", "--format", "csv", "-o", "{error}", "--plot", "error", "--pictures", "{stem}"),
        ("test", "{m}", "--format", "json", "-o", "{m}"),
    ],
    ids=" ".join,
)
def test_no_file_of_a_call_is_overwritten_by_another(arguments, tmp_path):
    text = run("models", "show", "pendulum").stdout
    names = {"m": "m.yaml", "json": "m.json", "gif": "m.gif", "error": "s-error.png", "map": "s-map.png"}
    names |= {"picture": "s-rod.theta.png", "stem": "s"}
    paths = {key: tmp_path / name for key, name in names.items()}
    for key in set(names) - {"stem"}:
        paths[key].write_text(text, encoding="utf-8")
    paths["link"] = tmp_path / "link.yaml"
    paths["link"].symlink_to(paths["m"])
    result = run(*(word.format(**paths) for word in arguments))
    assert result.exit_code == 2
    assert "would overwrite" in result.stderr or "name the same file" in result.stderr
    assert all(paths[key].read_text(encoding="utf-8") == text for key in set(names) - {"stem"})


def test_an_answer_goes_through_a_link_and_into_a_pipe(tmp_path):
    goal, link, pipe = tmp_path / "goal.txt", tmp_path / "link.txt", tmp_path / "pipe"
    goal.write_text("old", encoding="utf-8")
    link.symlink_to(goal)
    assert run("eig", "pendulum", "-o", str(link)).exit_code == 0
    assert link.is_symlink()
    assert "Verdict" in goal.read_text(encoding="utf-8")
    os.mkfifo(pipe)
    with child(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        assert run("eig", "pendulum", "-o", str(pipe)).exit_code == 0
        assert "Verdict" in reader.communicate(timeout=10)[0]
    assert pipe.is_fifo()


@pytest.mark.parametrize("words", ["eig pendulum", "models list", "test pendulum", "--help", "eig -h"])
def test_a_full_or_closed_stdout_is_said(words):
    command = f"{shlex.quote(sys.executable)} -m mbstab {words}"
    for redirection, message in ((">/dev/full", "to stdout: No space"), (">&-", "to stdout: it is closed")):
        failed = subprocess.run(f"{command} {redirection}", shell=True, capture_output=True, encoding="utf-8")
        assert failed.returncode == 1
        assert message in failed.stderr
        assert "Traceback" not in failed.stderr


def test_a_home_that_cannot_be_written_is_no_news(tmp_path):
    command = [sys.executable, "-m", "mbstab", "sweep", "pendulum.yaml", "--param", "L", "--points", "5"]
    environment = {name: text for name, text in os.environ.items() if name not in ("MPLCONFIGDIR", "XDG_CONFIG_HOME")}
    nowhere = tmp_path / "file" / "home"
    (tmp_path / "file").write_text("", encoding="utf-8")
    drawn = subprocess.run(
        [*command, "--plot", "map", "--pictures", str(tmp_path / "L"), "-q"], capture_output=True, encoding="utf-8",
        env={**environment, "HOME": str(nowhere)},
    )  # fmt: skip
    assert (drawn.returncode, drawn.stderr) == (0, "")


def test_a_reader_that_stops_early_is_no_error():
    command = f"{shlex.quote(sys.executable)} -m mbstab schema | head -1"
    assert subprocess.run(command, shell=True, capture_output=True, encoding="utf-8").stderr == ""


# --- equilibria, steady and periodic motions ------------------------------------------------------------------------

HANGING = """\
mbstab: 1
title: A rod on a pivot
gravity: [0, -9.81]
bodies:
  rod: {type: planar, mass: 2, shape: {type: rod, length: 1}, points: {O: [-0.5, 0]}}
joints:
  pivot: {type: revolute, between: [rod.O, ground]}
reference:
  find: equilibrium
  guess: {rod: {x: 0.3, y: -0.3, theta: -1}}
"""


@pytest.fixture
def hanging(tmp_path):
    path = tmp_path / "rod.yaml"
    path.write_text(HANGING, encoding="utf-8")
    return str(path)


def test_equilibrium_prints_coordinates_reactions_and_whether_it_is_isolated(hanging):
    result = run("equilibrium", hanging)
    assert (result.exit_code, result.stderr) == (0, "")
    lines = result.stdout.splitlines()
    assert lines[0] == "A rod on a pivot"
    assert any(line.split() == ["rod.theta", "-1.570796327", "rad"] for line in lines)
    assert any(line.split() == ["joint", "'pivot'", "rod", "0,", "19.62", "0"] for line in lines)
    assert lines[-1] == "isolated"


@pytest.mark.parametrize(
    ("command", "model"),
    [
        *(("equilibrium", model) for model in ("pendulum", "governor", "bricard", "whipple_bicycle", "bead_on_hoop")),
        *(("equilibrium", model) for model in ("rotating_pendulum", "rolling_disk", "n_four_bar", "wheelset")),
        *(("eig", model) for model in ("governor", "rotating_pendulum", "bead_on_hoop", "bricard", "whipple_bicycle")),
        ("eig", "kapitza"),
    ],
)
def test_steady_and_periodic_answers_fit_eighty_columns(command, model):
    result = run(command, model)
    assert result.exit_code == 0
    long = [line for line in result.stdout.splitlines() if len(line) > 80 and " holonomic row" not in line]
    assert long == []


def test_equilibrium_json_has_the_keys_scripts_rely_on(hanging):
    data = json.loads(run("equilibrium", hanging, "--format", "json").stdout)
    assert (set(data), data["title"]) == ({"model", "title", "equilibria"}, "A rod on a pivot")
    (found,) = data["equilibria"]
    assert set(found) >= {
        *("coordinates", "rates", "steady", "reactions", "residual", "unbalanced_force", "unbalanced_torque"),
        *("iterations", "strategy", "isolated", "open", "symmetries", "redundant", "warnings"),
    }
    assert found["coordinates"]["rod.theta"] == -math.pi / 2
    assert (found["steady"], found["isolated"], found["open"]) == ("rest", True, [])
    (pivot,) = found["reactions"]
    assert set(pivot) == {"of", "on", "point", "force", "torque"}
    assert (pivot["of"], pivot["on"], len(pivot["point"])) == ("joint 'pivot'", "rod", 2)
    assert abs(pivot["force"][1] - 19.62) < 1e-13


def test_equilibrium_csv_is_one_number_a_line(hanging):
    text = run("equilibrium", hanging, "--starts", "6", "--format", "csv").stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    assert list(rows[0]) == ["solution", "quantity", "of", "value", "unit"]
    heights = {r["solution"]: float(r["value"]) for r in rows if (r["quantity"], r["of"]) == ("coordinate", "rod.y")}
    assert heights == {"1": pytest.approx(-0.5, abs=1e-15), "2": pytest.approx(0.5, abs=1e-15)}
    force = [r for r in rows if r["quantity"] == "force y"]
    assert [(r["of"], r["unit"]) for r in force] == [("joint 'pivot' on rod", "N")] * 2
    assert {r["unit"] for r in rows} == {"m", "m/s", "rad", "rad/s", "N", "N*m"}


def test_more_starts_list_all_solutions_and_a_seed_repeats_them(hanging):
    text = run("equilibrium", hanging, "--starts", "6").stdout
    assert "2 distinct solutions" in text
    assert [x for x in text.splitlines() if x.startswith("Equil")] == ["Equilibrium 1 of 2", "Equilibrium 2 of 2"]
    one, other = (run("equilibrium", hanging, "--starts", "6", "--seed", "7", "--format", "json") for _ in range(2))
    assert one.stdout == other.stdout
    assert one.stderr == ""  # the progress bar is for terminals


FALLING = "mbstab: 1\ngravity: [0, -9.81]\nbodies: {b: {type: planar_point, mass: 1}}\nreference: {find: equilibrium}\n"


@pytest.mark.parametrize(
    ("text", "arguments", "code", "message"),
    [
        (FALLING, (), 1, "no spring or joint resists b.y"),
        (FALLING, ("--starts", "3"), 1, "no spring or joint resists b.y"),
        (FALLING.replace("equilibrium", "rest"), (), 2, "reference.find"),
        (FALLING.replace("equilibrium", "steady"), (), 2, "a steady motion needs its symmetry"),
        (HANGING, ("--starts", "0"), 2, "--starts"),
        (HANGING, ("--seed", "-1"), 2, "--seed"),
        (HANGING, ("--set", "k=1"), 2, "has no parameter 'k'"),
        (HANGING, ("--format", "npz"), 2, "--format"),
    ],
)
def test_exit_codes_of_equilibrium(tmp_path, text, arguments, code, message):
    path = tmp_path / "model.yaml"
    path.write_text(text, encoding="utf-8")
    result = run("equilibrium", str(path), *arguments)
    assert (result.exit_code, result.stdout) == (code, "")
    assert message in result.stderr


def test_eig_of_a_motion_that_is_not_found_fails_in_the_same_words(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(FALLING, encoding="utf-8")
    equilibrium, eig = run("equilibrium", str(path)), run("eig", str(path))
    assert (eig.exit_code, eig.stdout) == (1, "")
    assert eig.stderr == equilibrium.stderr
    assert f"{path}:4:1: reference: " in eig.stderr


def test_what_is_not_known_of_reactions_is_said_and_warned_of(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(
        HANGING.replace("joints:", "joints:\n  again: {type: revolute, between: [rod.O, ground]}"), encoding="utf-8"
    )
    result = run("equilibrium", str(path))
    assert result.exit_code == 0
    assert "warning: redundant constraint" in result.stderr
    assert "warning" not in result.stdout
    assert "only sums of reactions are determined" in result.stdout
    (found,) = json.loads(run("equilibrium", str(path), "--format", "json").stdout)["equilibria"]
    assert len(found["redundant"]) == 2
    assert abs(sum(r["force"][1] for r in found["reactions"]) - 19.62) < 1e-12


def test_frozen_eigenvalues_are_labelled():
    shown = run("eig", "rotating_pendulum", "--frozen")
    assert shown.exit_code == 0
    assert "Verdict: undecided" in shown.stdout
    assert "frozen" in shown.stdout
    assert "8i" in shown.stdout
    assert "in the frame of" not in shown.stdout
    data = answer("rotating_pendulum", "--frozen")
    assert (data["frozen_time"], data["frame"], data["verdict"]) == (True, "", "undecided")
    data = answer("rotating_pendulum")
    assert (data["frozen_time"], data["verdict"]) == (False, "stable")
    assert data["frame"].startswith("rotation about z")
    assert run("eig", "rotating_pendulum", "--frozen", "--require", "marginal").exit_code == 3
    assert run("eig", "rotating_pendulum", "--require", "marginal").exit_code == 0


def test_only_what_can_be_simplified_in_time_is(monkeypatch):
    result = CliRunner().invoke(main, ["linearize", "pendulum.yaml", "--symbolic", "--format", "latex"])
    assert "not simplified" not in result.stderr
    monkeypatch.setattr("mbstab.analysis.linear.tolerances.Tolerances.simplified_weight", 2)
    result = CliRunner().invoke(main, ["linearize", "pendulum.yaml", "--symbolic", "--format", "latex"])
    assert result.exit_code == 0
    assert re.search(r"\d+ entries are not simplified", result.stderr)


@pytest.mark.long
def test_large_symbolic_matrices_are_not_simplified():
    result = CliRunner().invoke(main, ["linearize", "whipple_bicycle.yaml", "--symbolic", "--format", "latex"])
    assert result.exit_code == 0
    assert "not simplified" in result.stderr


@pytest.mark.parametrize("section", ["reference", "reference.steady", "expect", "sweep", "constraints", "parameters"])
def test_sections_without_types_are_documented_as_well(section):
    result = CliRunner().invoke(main, ["schema", section])
    assert result.exit_code == 0
    assert ": " in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80
