"""Where answers go: formats, files that are kept apart, full disks, and what reaches the terminal."""

import csv
import io
import json
import os
import random
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import unicodedata
from contextlib import contextmanager
from contextvars import copy_context
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner
from sampling import sample
from scipy.io import loadmat

import mbstab
from mbstab.cli import main
from mbstab.errors import visible
from mbstab.model.library import models_folder
from mbstab.report import set_width
from mbstab.report.eigenvalues import eigen_text
from mbstab.report.tables import eigenvalue

PENDULUM = models_folder() / "pendulum.yaml"
SWEEP = ("sweep", PENDULUM, "--param", "L", "--from", "0.1", "--to", "0.3", "--points", "4", "--plot", "none")
COMMANDS = {
    "eig": (("eig", PENDULUM), ("txt", "json", "csv")),
    "eig of several": (("eig", PENDULUM, models_folder() / "top.yaml"), ("txt", "json", "csv")),
    "eig --precision": (("eig", PENDULUM, "--precision", "20"), ("txt", "json", "csv")),
    "eig --certify": (("eig", PENDULUM, "--certify"), ("txt", "json")),
    "check": (("check", PENDULUM), ("txt", "json")),
    "energy": (("energy", PENDULUM), ("txt", "json")),
    "equilibrium": (("equilibrium", PENDULUM), ("txt", "json", "csv")),
    "linearize": (("linearize", PENDULUM), ("txt", "json", "csv", "npz", "mat", "tex")),
    "linearize --symbolic": (("linearize", PENDULUM, "--symbolic"), ("txt", "tex")),
    "design": (("design", PENDULUM, "--vary", "L=5%", "--goal", "decay"), ("txt", "json", "yaml")),
    "response": (("response", models_folder() / "whipple_bicycle.yaml"), ("txt", "json", "csv")),
    "sweep": (SWEEP, ("txt", "json", "csv", "npz")),
    "simulate": (("simulate", PENDULUM, "--to", "0.1", "--points", "3"), ("txt", "json", "csv", "npz")),
    "test": (("test", PENDULUM), ("txt", "json", "xml")),
    "models list": (("models", "list"), ("txt", "json", "csv")),
    "schema": (("schema",), ("json",)),
}
WRITTEN = [(name, suffix) for name, (_, suffixes) in COMMANDS.items() for suffix in suffixes]


def run(*arguments, **options):
    return CliRunner().invoke(main, [str(x) for x in arguments], **options)


def readable(path):
    """Whether a file holds what its suffix says."""
    data = path.read_bytes()
    match path.suffix:
        case ".json":
            json.loads(data)
        case ".csv":
            rows = list(csv.reader(io.StringIO(data.decode())))
            assert len(rows) > 1
            assert len({len(row) for row in rows}) == 1
        case ".npz":
            with np.load(path) as arrays:
                assert arrays.files
        case ".mat":
            assert loadmat(path)
        case ".xml":
            assert ElementTree.fromstring(data).tag == "testsuites"
        case ".tex":
            assert b"\\" in data
        case _:
            assert b"{" not in data[:1]
    return True


@pytest.mark.parametrize(("name", "suffix"), WRITTEN)
def test_the_suffix_says_the_format(name, suffix, tmp_path):
    path = tmp_path / f"answer.{suffix}"
    result = run(*COMMANDS[name][0], "-o", path)
    assert result.exit_code == 0, result.stderr
    assert [x.name for x in tmp_path.iterdir()] == [path.name]
    assert readable(path)


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("output", ["answer.foo", "answer", "missing/answer.txt", "folder.txt", "a\x1b[31m.txt"])
def test_an_output_that_cannot_be_is_refused_before_anything_is_computed(name, output, tmp_path):
    (tmp_path / "folder.txt").mkdir()
    result = run(*COMMANDS[name][0], "-o", tmp_path / output)
    assert result.exit_code == 2
    assert "hint:" in result.stderr or "cannot be written" in result.stderr or "cannot be seen" in result.stderr
    assert [x.name for x in tmp_path.iterdir()] == ["folder.txt"]


@contextmanager
def no_files_above(size):
    """Let no file grow beyond a size in bytes, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize(("name", "suffix"), sample(WRITTEN, 3))
def test_a_full_disk_leaves_a_whole_file_or_none(name, suffix, tmp_path, monkeypatch):
    path = tmp_path / f"answer.{suffix}"
    path.write_text("before", encoding="utf-8")
    whole = tmp_path / f"whole.{suffix}"
    assert run(*COMMANDS[name][0], "-o", whole).exit_code == 0
    sizes = (1, whole.stat().st_size // 2)
    spare = tmp_path / "spare"
    spare.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(spare))
    for size in sizes:
        with no_files_above(size):
            result = run(*COMMANDS[name][0], "-o", path)
        assert result.exit_code == 1, result.stderr
        assert "cannot be written: File too large" in result.stderr
        assert "Traceback" not in result.stderr
        assert path.read_text(encoding="utf-8") == "before"
        # What a sweep has computed can be resumed.
        shutil.rmtree(tmp_path / f"{path.name}.parts", ignore_errors=True)
    assert sorted(x.name for x in tmp_path.iterdir()) == sorted([path.name, whole.name, "spare"])


def test_a_copy_for_which_there_is_no_room_does_not_block_the_next(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with no_files_above(10):
        assert run("models", "copy", "pendulum").exit_code == 1
    assert list(tmp_path.iterdir()) == []
    assert run("models", "copy", "pendulum").exit_code == 0
    assert (tmp_path / "pendulum.yaml").read_bytes() == PENDULUM.read_bytes()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("eig", "--help"), ("eig", PENDULUM), ("schema",)])
def test_a_full_stdout_is_said(arguments):
    command = [sys.executable, "-m", "mbstab", *map(str, arguments)]
    with open("/dev/full", "w") as full:
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, encoding="utf-8", timeout=60)
    assert result.returncode == 1
    assert "cannot be written to stdout: No space left on device" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_without_the_letters_gets_the_answer(encoding):
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
    command = [sys.executable, "-m", "mbstab", "eig", str(PENDULUM)]
    result = subprocess.run(command, capture_output=True, env=environment, timeout=60)
    assert result.returncode == 0
    assert b"Verdict: stable" in result.stdout


# --- the terminal ---------------------------------------------------------------------------------------------------

UNSEEN = [
    "\x1b]0;x\x07", "\x1b[31m", "\x00", "\x7f", "\x9b2J", "\u202e", "\u200b", "\u2028", "\r", "\x08",
    "\U000e0041",
]  # fmt: skip


def clean(text):
    """Whether a text holds nothing that a terminal obeys or hides."""
    return all(c.isprintable() or c in "\n\t" or unicodedata.category(c) == "Zs" for c in text)


def said(*arguments, **options):
    result = run(*arguments, **options)
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert clean(result.stdout)
    assert clean(result.stderr)
    return result


@pytest.mark.parametrize("unseen", UNSEEN, ids=ascii)
def test_nothing_invisible_in_a_file_reaches_the_terminal(unseen, tmp_path):
    escape = '"' + "".join(f"\\U{ord(c):08x}" for c in "a" + unseen) + '"'
    text = PENDULUM.read_text(encoding="utf-8")
    places = {
        "title": text.replace("title: Physical pendulum", f"title: {escape}"),
        "key": text + f"{escape}: 1\n",
        "parameter": text.replace("  L:", f"  {escape}: 3\n  L:"),
        "description": text.replace("description: half length", f"description: {escape}"),
        "raw": text.replace("Physical", unseen),
    }
    for place, changed in places.items():
        assert changed != text, place
        (tmp_path / "m.yaml").write_bytes(changed.encode("utf-8"))
        for command in ("check", "eig"):
            assert said(command, tmp_path / "m.yaml").exit_code == (0 if place == "raw" and unseen == "\r" else 2)


@pytest.mark.parametrize("unseen", UNSEEN[:2] + UNSEEN[5:], ids=ascii)
def test_nothing_invisible_on_the_command_line_reaches_the_terminal(unseen, tmp_path):
    name = tmp_path / f"a{unseen}.yaml"
    shutil.copy(PENDULUM, name)
    for arguments in (
        ("eig", name), ("test", name), ("models", "show", name), ("models", "copy", "pendulum", tmp_path / unseen),
        ("eig", PENDULUM, "--set", f"L{unseen}x=1"), ("eig", PENDULUM, "--set", f"L={unseen}"),
        ("eig", PENDULUM, "--method", unseen), ("eig", PENDULUM, f"--{unseen}"), (f"e{unseen}",),
        ("sweep", PENDULUM, "--param", f"L{unseen}"), ("simulate", PENDULUM, "--plot", unseen),
        ("simulate", PENDULUM, "--perturb", f"{unseen}=1"), ("schema", unseen), ("eig", "-o", name, PENDULUM),
        ("simulate", PENDULUM, "--trace", unseen, "--animate", tmp_path / "a.gif"),
    ):  # fmt: skip
        assert said(*arguments).exit_code == 2


def test_a_title_with_line_breaks_is_one_line(tmp_path):
    for title in ('"A pendulum\\nVerdict: unstable"', "|\n  A pendulum\n  Verdict: unstable\n"):
        (tmp_path / "m.yaml").write_text(
            PENDULUM.read_text(encoding="utf-8").replace("title: Physical pendulum", f"title: {title}"),
            encoding="utf-8",
        )
        text = said("eig", tmp_path / "m.yaml").stdout
        assert text.splitlines()[0] == "A pendulum Verdict: unstable"
        assert [line for line in text.splitlines()[1:] if "Verdict" in line] == ["✔ Verdict: stable"]


def test_escapes_of_unseen_characters_are_those_of_json():
    generator = random.Random(1)
    for _ in range(2000):
        text = "".join(
            chr(generator.choice([generator.randrange(0x300), generator.randrange(0xD800)])) for _ in range(9)
        )
        shown = visible(text + UNSEEN[-1], lines=False)
        assert clean(shown)
        assert "\n" not in shown
        assert json.loads(visible(json.dumps(text, ensure_ascii=False))) == text


# --- manners --------------------------------------------------------------------------------------------------------


def test_a_model_comes_from_stdin(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = PENDULUM.read_text(encoding="utf-8")
    result = run("eig", "-", "--format", "json", input=text)
    assert json.loads(result.stdout)["model"] == "<stdin>"
    assert json.loads(result.stdout)["verdict"] == "stable"
    wrong = run("check", "-", input=text.replace("mass: m", "mass: -1"))
    assert wrong.exit_code == 2
    assert wrong.stderr.startswith("<stdin>:")
    drawn = run("sweep", "-", *SWEEP[2:-2], "--plot", "map", input=text)
    assert drawn.exit_code == 0, drawn.stderr
    assert [x.name for x in tmp_path.iterdir()] == ["stdin-L-map.png"]


def test_a_closed_stdin_is_said():
    command = f"{shlex.quote(sys.executable)} -m mbstab eig - <&-"
    failed = subprocess.run(command, shell=True, capture_output=True, encoding="utf-8")
    assert failed.returncode == 2
    assert "stdin cannot be read: it is closed\nhint: give the name of a file" in failed.stderr


def test_several_files_are_answered_one_after_the_other(tmp_path):
    (tmp_path / "wrong.yaml").write_text("mbstab: 2\n", encoding="utf-8")
    names = ("pendulum.yaml", tmp_path / "wrong.yaml", "top.yaml")
    result = run("eig", *names, "--format", "json")
    assert [x["verdict"] for x in json.loads(result.stdout)] == ["stable", "marginally stable"]
    assert result.exit_code == 2
    assert "wrong.yaml:1:9" in result.stderr
    required = run("eig", "pendulum.yaml", "top.yaml", "--require", "stable")
    assert required.exit_code == 3
    assert "top.yaml: required: stable, found: marginally stable" in required.stderr
    assert run("eig", "top.yaml", "top.yaml").exit_code == 2


def test_quiet_leaves_only_the_answer(tmp_path):
    loud, quiet = run("eig", "top.yaml"), run("eig", "top.yaml", "--quiet")
    assert loud.stdout == quiet.stdout
    assert "using the example model" in loud.stderr
    assert quiet.stderr.splitlines() == [line for line in loud.stderr.splitlines() if line.startswith("warning: ")]
    assert run("eig", "pendulum.yaml", "-q", "-o", tmp_path / "a.json").output == ""


def test_too_little_memory_is_said(monkeypatch):
    def greedy(*_, **__):
        raise MemoryError("Unable to allocate 11.9 GiB")

    monkeypatch.setattr("mbstab.api.Mechanism.check", greedy)
    result = run("check", "pendulum.yaml")
    assert result.exit_code == 1
    assert "memory" in result.stderr
    assert "11.9 GiB" in result.stderr


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("eig pendu", "pendulum.yaml"),
        ("test ro", "rolling_disk.yaml"),
        ("eig pendulum.yaml --set ", "L="),
        ("sweep top.yaml --param om", "omega"),
        ("simulate pendulum.yaml --plot ", "rate(rod.theta)"),
        ("simulate pendulum.yaml --plot en", "energy"),
        ("simulate pendulum.yaml --plot an", "angle(pivot)"),
    ],
)
def test_the_shell_completes_models_parameters_and_quantities(words, found, monkeypatch, capsys):
    words = f"mbstab {words}"
    environment = {"_MBSTAB_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit):
        main(prog_name="mbstab")
    assert found in [line.partition(",")[2] for line in capsys.readouterr().out.splitlines()]


def test_the_package_shows_its_interface():
    assert {"load", "loads", "Mechanism", "MbstabError", "__version__"} <= set(dir(mbstab))
    assert all(not name.startswith("_") or name == "__version__" for name in dir(mbstab))


def test_vectors_belong_to_their_eigenvalues():
    mechanism = mbstab.load("double_pendulum.yaml")
    result, linear = mechanism.eig(), mechanism.linearize()
    data = json.loads(run("eig", "double_pendulum.yaml", "--format", "json").stdout)
    assert [x["name"] for x in data["coordinates"]] == list(linear.names) == list(result.coordinates)
    sizes = linear.motion.sizes
    for e, written in zip(result.eigenvalues, data["eigenvalues"], strict=True):
        vector = e.vector
        polar = np.array(written["vector"]["magnitude"]) * np.exp(1j * np.array(written["vector"]["phase"]))
        np.testing.assert_allclose(polar, vector, rtol=1e-14, atol=1e-14)
        moved = linear.M @ vector * e.value**2 + linear.R @ vector * e.value + linear.K @ vector
        # The rest is borne by the constraints.
        bearing = np.linalg.lstsq(linear.J.T.astype(complex), -moved, rcond=None)[0]
        np.testing.assert_allclose(linear.J.T @ bearing, -moved, atol=1e-11 * np.abs(linear.K).max())
        np.testing.assert_allclose(linear.J @ vector, 0.0, atol=1e-12)
        largest = np.argmax(np.abs(vector) / sizes)
        assert vector[largest] == 1.0


@pytest.mark.few(1)
@pytest.mark.parametrize("name", sample(sorted(path.stem for path in models_folder().glob("*.yaml")), 3))
def test_tables_fit_80_columns(name):
    for arguments in (("check",), ("eig",), ("equilibrium",), ("linearize",), ("test",)):
        result = run(*arguments, f"{name}.yaml")
        # The name of a file stays in one piece.
        lines = [line.replace(str(models_folder()), "") for line in result.stdout.splitlines()]
        too_long = [line for line in lines if len(line) > 80]
        assert not too_long, too_long[:3]


def test_a_name_near_that_of_a_file_or_an_example_is_suggested(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(PENDULUM, tmp_path / "rotor.yaml")
    assert "did you mean 'rotor.yaml'?" in run("eig", "rotr.yaml").stderr
    assert "did you mean 'rotor.yaml'?" in run("eig", "./rotr.yaml").stderr
    assert "did you mean 'pendulum'?" in run("eig", "pendulun.yaml").stderr


@pytest.mark.parametrize("name", [".", "/dev/zero", sys.executable])
def test_what_is_no_text_is_not_shown(name):
    result = said("models", "show", name)
    assert result.exit_code == 2
    assert any(x in result.stderr for x in ("is a folder", "cannot be read", "at most", "not UTF-8"))


@pytest.mark.parametrize("place", ["missing/x.png", "a\x1b[31m.png", "folder"])
@pytest.mark.parametrize("command", ["sweep", "simulate"])
def test_pictures_that_cannot_be_drawn_are_refused_before_anything_is_computed(command, place, tmp_path, monkeypatch):
    def computed(*_, **__):
        raise AssertionError("computed")

    monkeypatch.setattr(f"mbstab.api.Mechanism.{command}", computed)
    for name in ("map", "locus", "rod.theta"):
        (tmp_path / f"folder-{name}.png").mkdir()
    arguments = {"sweep": ("--param", "L", "--from", "1", "--to", "2"), "simulate": ("--plot", "rod.theta")}[command]
    result = run(command, PENDULUM, *arguments, "--pictures", tmp_path / place)
    assert result.exit_code == 2
    assert "cannot be written" in result.stderr or "cannot be seen" in result.stderr


def test_a_dash_is_stdout(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("eig", PENDULUM, "--format", "csv", "-o", "-")
    assert result.stdout.startswith("real (1/s),")
    assert list(tmp_path.iterdir()) == []


def test_eigenvalues_that_left_the_range_are_no_answer(tmp_path):
    text = run("models", "show", "double_pendulum").stdout
    codes = set()
    for value in ("1e-60", "1e-150", "1e150"):
        path = tmp_path / "m.yaml"
        path.write_text(text, encoding="utf-8")
        for name in ("m", "l", "g"):
            result = run("eig", path, "--set", f"{name}={value}")
            codes.add(result.exit_code)
            assert "nan" not in result.stdout
    assert codes <= {0, 1, 2}


def test_long_lists_of_neutral_directions_are_shortened_but_in_json(tmp_path):
    path = tmp_path / "many.yaml"
    path.write_text(
        "mbstab: 1\nbodies:\n" + "".join(f"  b{i}: {{type: point, mass: 1}}\n" for i in range(12)), encoding="utf-8"
    )
    text = run("eig", path).stdout
    (shown,) = re.findall(r"72 zeros explained by (?s:.*?)\n\n", text)
    assert len(shown.splitlines()) <= 6
    assert "66 more" in " ".join(shown.split())
    modulo = json.loads(run("eig", path, "--format", "json").stdout)["modulo"]
    assert len(modulo["symmetries"]) + len(modulo["family"]) == 72


def test_what_neutral_eigenvalues_belong_to_is_said_beside_an_unstable_one(tmp_path):
    path = tmp_path / "cart.yaml"
    path.write_text(
        "mbstab: 1\nbodies:\n  cart: {type: point, mass: 1}\n"
        "forces:\n  push: {type: expression, on: {cart.x: 3*cart.x}}\n",
        encoding="utf-8",
    )
    assert "4 zeros explained by the positions cart.y and cart.z and the speeds of cart.y" in " ".join(
        run("eig", path).stdout.split()
    )
    data = json.loads(run("eig", path, "--format", "json").stdout)
    assert data["verdict"] == "unstable"
    assert data["neutral_directions"][:2] == ["cart.y", "cart.z"]


def test_matrices_that_nobody_reads_are_refused(monkeypatch, capsys):
    monkeypatch.setattr("mbstab.analysis.linear.tolerances.Tolerances.printed_operations", 10)
    with pytest.raises(SystemExit) as stop:
        main(["linearize", "double_pendulum.yaml", "--symbolic"])
    assert stop.value.code == 2
    assert "more than 10 operations in symbols" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        main(["linearize", "double_pendulum.yaml", "--symbolic", "--force"])
    assert not stop.value.code


def test_values_in_a_unit_are_those_that_were_asked_for(tmp_path):
    path = tmp_path / "rotor.yaml"
    path.write_text(
        "mbstab: 1\nparameters: {n: {value: 3000, unit: rpm}, k: 1}\nbodies:\n  p: {type: point, mass: 1}\n"
        "forces:\n  f: {type: expression, on: {p.x: -k*n*p.x, p.y: -k*n*p.y, p.z: -k*n*p.z}}\n",
        encoding="utf-8",
    )
    asked = ("sweep", path, "--param", "n", "--from", 500, "--to", 4000, "--points", 8)
    lines = run(*asked, "--format", "csv").stdout.splitlines()
    assert [float(line.split(",")[0]) for line in lines[1:9]] == [500.0 * i for i in range(1, 9)]
    data = json.loads(run("eig", path, "--set", "n=1500", "--format", "json").stdout)
    assert data["parameters"]["n"]["value"] == 1500.0


def test_an_expected_critical_value_is_in_the_unit_of_its_parameter(tmp_path):
    path = tmp_path / "wheelset.yaml"
    text = run("models", "show", "whipple_bicycle").stdout
    path.write_text(
        text.replace("v: {value: 5, unit: m/s", "v: {value: 18, unit: km/h").partition("expect:")[0]
        + "expect:\n- critical: {parameter: v, value: 15.45257713, tolerance: 1e-8, below: unstable, "
        "above: asymptotically stable up to symmetry}\n",
        encoding="utf-8",
    )
    result = run("test", str(path))
    assert "critical at 15.45257713 km/h" in result.stdout
    assert "1 passed, 0 failed" in result.stdout


END = """
import atexit, sys
from mbstab.cli import program
atexit.register(print, "the end")
sys.argv[1:] = ["eig", "pendulum.yaml", *sys.argv[1:]]
program()
"""


@pytest.mark.parametrize(("more", "code"), [([], 0), (["--require", "asymptotic"], 3)])
def test_what_is_registered_for_the_end_of_a_process_is_run_and_written(more, code):
    ended = subprocess.run([sys.executable, "-c", END, *more], capture_output=True, encoding="utf-8")
    assert (ended.returncode, ended.stdout.splitlines()[-1]) == (code, "the end")


def test_a_profile_of_a_process_is_written(tmp_path):
    profile = tmp_path / "profile"
    command = [sys.executable, "-m", "cProfile", "-o", str(profile), "-m", "mbstab", "eig", "pendulum.yaml"]
    subprocess.run(command, capture_output=True, check=True)
    assert profile.stat().st_size


@pytest.mark.parametrize(
    ("gravity", "none"),
    [("", True), ("gravity: [0, 0]\n", True), ("gravity: [0, -9.81]\n", False), ("gravity: [1e-9, 0]\n", False)],
)
def test_check_says_where_there_is_no_gravity(gravity, none, tmp_path):
    path = tmp_path / "free.yaml"
    path.write_text(
        f"mbstab: 1\n{gravity}bodies: {{p: {{type: planar, mass: 1, inertia: 1}}}}\n"
        "joints: {pin: {type: fixed, between: [p, ground]}}\n",
        encoding="utf-8",
    )
    told, data = (CliRunner().invoke(main, ["check", str(path), *f]).stdout for f in ((), ("--format", "json")))
    assert told.splitlines()[0] == "planar scene, 1 body, 3 coordinates" + ", no gravity" * none
    assert any(json.loads(data)["gravity"]) == (not none)


# --- terminals with fewer than 80 columns -----------------------------------------------------------------------------


def narrowed(columns, text):
    """Return a text as it is written for a terminal of that width."""

    def written():
        set_width(columns)
        return text()

    return copy_context().run(written)


@pytest.mark.parametrize("columns", [60, 50])
@pytest.mark.parametrize("name", ["bogie.yaml", "whipple_bicycle.yaml", "gear_train.yaml"])
def test_tables_fit_a_narrow_terminal_and_keep_their_numbers(name, columns):
    mechanism = mbstab.load(name)
    result = mechanism.eig()
    whole, narrow = (narrowed(n, lambda: eigen_text(result, None)) for n in (80, columns))
    assert max(map(len, whole.splitlines())) <= 80
    assert max(map(len, narrow.splitlines())) <= columns
    for e in (e for e in result.eigenvalues if e.value.imag >= 0.0 and not e.exact):
        assert eigenvalue(e.value if abs(e.value.real) > e.error_bound else 1j * e.value.imag) in narrow


def test_a_terminal_tells_its_width_and_a_file_does_not(tmp_path):
    """The command asks the terminal; what goes to a file is as wide as ever."""
    ours, theirs = os.openpty()
    environment = {**os.environ, "COLUMNS": "60", "NO_COLOR": "1"}
    command = [sys.executable, "-m", "mbstab", "eig", "bogie.yaml"]
    for more, wide in (([], 60), (["--output", str(tmp_path / "a.txt")], 80)):
        process = subprocess.run([*command, *more], stdout=theirs, stderr=subprocess.DEVNULL, env=environment)
        assert process.returncode == 0
        text = (tmp_path / "a.txt").read_text(encoding="utf-8") if more else os.read(ours, 65536).decode()
        assert 0.9 * wide < max(map(len, text.splitlines())) <= wide
    os.close(ours)
    os.close(theirs)
