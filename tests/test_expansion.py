"""Counts, repetitions and included parts: what they write out, what is refused, and where messages point."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from scipy.linalg import eigh

import mbstab
from mbstab.cli.main import main
from mbstab.errors import MbstabError, ModelFileError, UsageError
from mbstab.model.expansion import MAX_NODES
from mbstab.model.library import installed_models
from mbstab.model.reader import expanded_text

CHAIN = """\
mbstab: 1
counts: {N: COUNT}
parameters: {m: 2, k: 100}
repeat:
  - for: {i: [1, N]}
    bodies: {b<i>: {type: planar_point, mass: m}}
    constraints: {rail<i>: {holonomic: b<i>.y}}
    reference: {coordinates: {b<i>: {x: 0.1*<i>}}}
  - for: {i: [2, N]}
    forces: {spring<i>: {type: spring, between: [b<i-1>, b<i>], stiffness: k, length: 0.1}}
forces:
  first: {type: spring, between: [ground, b1], stiffness: k, length: 0.1}
"""

WHEEL = """\
mbstab: 1
title: a wheel <1>
needs: {mount: the body that carries it}
counts: {S: 1}
parameters:
  m: 3
  k: {value: 100, unit: N/m, description: stiffness of the tyre}
bodies:
  hub: {type: planar_point, mass: m}
constraints:
  rail: {holonomic: hub.y}
ground:
  points: {foot: [1, 0]}
repeat:
  - for: {j: [1, S]}
    forces:
      pull<j>: {type: expression, on: {hub.x: -k*(hub.x - mount.x)/<S>, mount.x: k*(hub.x - mount.x)/<S>}}
forces:
  tyre: {type: spring, between: [ground.foot, hub], stiffness: k, length: 1}
"""

CAR = """\
mbstab: 1
parameters: {stiff: 200}
bodies:
  chassis: {type: planar_point, mass: 10}
constraints:
  straight: {holonomic: chassis.y}
include:
  - {file: wheel.yaml, prefix: front_, with: {mount: chassis, k: stiff, S: 3}}
  - {file: wheel.yaml, prefix: rear_, with: {mount: chassis}}
"""


@pytest.fixture
def car(tmp_path):
    (tmp_path / "wheel.yaml").write_text(WHEEL, encoding="utf-8")
    (tmp_path / "car.yaml").write_text(CAR, encoding="utf-8")
    return tmp_path / "car.yaml"


def frequencies(K, M):
    return np.sort(np.sqrt(eigh(K, M, eigvals_only=True)))


@pytest.mark.parametrize("count", [1, 2, 7])
def test_a_chain_of_masses_is_written_once(count):
    found = mbstab.loads(CHAIN.replace("COUNT", str(count))).eig()
    K = 100.0 * (2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1))
    K[-1, -1] = 100.0
    own = np.sort([x.imag for x in found.values() if x.imag > 0.0])
    assert own == pytest.approx(frequencies(K, 2.0 * np.eye(count)), rel=1e-13)


def test_a_part_is_included_twice_with_its_own_values(car):
    model = mbstab.load(car)
    assert list(model.model.bodies) == ["chassis", "front_hub", "rear_hub"]
    K = np.array([[300.0, -200.0, -100.0], [-200.0, 400.0, 0.0], [-100.0, 0.0, 200.0]])
    own = np.sort([x.imag for x in model.eig().values() if x.imag > 0.0])
    assert own == pytest.approx(frequencies(K, np.diag([10.0, 3.0, 3.0])), rel=1e-13)
    softer = mbstab.load(car).at(rear_k="50", stiff="100")
    K = np.array([[150.0, -100.0, -50.0], [-100.0, 200.0, 0.0], [-50.0, 0.0, 100.0]])
    own = np.sort([x.imag for x in softer.eig().values() if x.imag > 0.0])
    assert own == pytest.approx(frequencies(K, np.diag([10.0, 3.0, 3.0])), rel=1e-13)
    swept = model.sweep("rear_k", np.array([50.0, 100.0]))
    assert not swept.problems


def test_the_expanded_file_has_bit_for_bit_the_same_answer(car, tmp_path):
    chain = tmp_path / "chain.yaml"
    chain.write_text(CHAIN.replace("COUNT", "4"), encoding="utf-8")
    for path in (car, chain):
        written = CliRunner().invoke(main, ["check", str(path), "--expanded"])
        assert written.exit_code == 0
        assert "include" not in written.stdout
        assert "repeat" not in written.stdout
        other = tmp_path / "expanded.yaml"
        other.write_text(written.stdout, encoding="utf-8")
        answers = [
            json.loads(CliRunner().invoke(main, ["eig", str(x), "--format", "json"]).stdout) for x in (path, other)
        ]
        for answer in answers:
            del answer["model"]
        assert answers[0] == answers[1]


def test_each_installed_model_is_one_file():
    """No installed model includes parts, so that one file can be copied; repetitions written out are the same model."""
    for path in installed_models():
        model = mbstab.load(path).model
        sections = {line.partition(":")[0] for line in model.document.lines}
        assert not {"include", "needs"} & sections
        if {"repeat", "counts"} & sections:
            again = mbstab.loads(expanded_text(model)).model
            assert (again.coordinates(), list(again.entries)) == (model.coordinates(), list(model.entries))


def test_an_index_in_an_index_and_a_part_in_a_repetition(tmp_path):
    (tmp_path / "mass.yaml").write_text(
        "mbstab: 1\nparameters: {m: 1}\nbodies: {p: {type: planar_point, mass: m}}\n"
        "constraints: {fixed: {holonomic: p.y}}\n"
        "forces: {hold: {type: expression, on: {p.x: -4*p.x}}}\n",
        encoding="utf-8",
    )
    (tmp_path / "grid.yaml").write_text(
        "mbstab: 1\nrepeat:\n  - for: {i: [1, 2], j: [0, i]}\n".replace("[0, i]", "[0, 1]")
        + "    repeat: {for: {k: [<i>, 2]}, "
        + "include: {file: mass.yaml, prefix: p<i>_<j>_<k>_, with: {m: <10*i + k>}}}\n",
        encoding="utf-8",
    )
    model = mbstab.load(tmp_path / "grid.yaml")
    assert list(model.model.bodies) == ["p1_0_1_p", "p1_0_2_p", "p1_1_1_p", "p1_1_2_p", "p2_0_2_p", "p2_1_2_p"]
    own = np.sort([x.imag for x in model.eig().values() if x.imag > 0.0])
    assert own == pytest.approx(np.sort(np.sqrt(4.0 / np.array([11, 12, 11, 12, 22, 22]))), rel=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[2, N]", "[2, M]", r"chain:9:18: repeat\.for\.i: there is no count or index 'M'"),
        ("<i-1>", "<i/2>", r"'i/2' is not a whole number"),
        ("<i-1>", "<j>", r"chain:10:\d+: .*there is no count or index 'j'"),
        ("[2, N]", "[2]", r"expected the first and the last value"),
        ("b<i>: {type", "b: {type", r"chain:6:14: bodies\.b: the name 'b' is there already, from chain:6"),
        ("[1, N]", "[1, 1000000000]", r"1000000000 repetitions are too many"),
        ("for: {i: [2, N]}", "fro: {i: [2, N]}", r"the key 'for' is missing"),
        ("COUNT", "2.5", r"chain:2:13: counts\.N: '2\.5' is not a whole number"),
        ("mass: m}", "mas: m}", r"chain:6:41: bodies\.b1: unknown key 'mas'"),
        ("    forces:", "    sweep: {m: {from: 1, to: 2}}\n    forces:", r"the section 'sweep' cannot be repeated"),
    ],
)
def test_bad_repetitions_are_refused_where_they_stand(old, new, message):
    with pytest.raises(ModelFileError, match=message):
        mbstab.loads(CHAIN.replace(old, new).replace("COUNT", "3"), name="chain")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("repeat:\n  - for: {i: [1, »N]}\n    BODIES", "the range of i, from 1 to N = 0, is empty"),
        ("repeat:\n  - for: {i: [»N + 1, 2*N]}\n    BODIES", "the range of i, from N + 1 = 1 to 2*N = 0, is empty"),
        ("repeat:\n  - for: {i: [1, 2], j: [»3, 2]}\n    BODIES", "the range of j, from 3 to 2, is empty"),
        (
            "repeat:\n  - for: {k: [1, 2]}\n    repeat: {for: {i: [1, »<N>]}, BODIES}",
            "the range of i, from 1 to N = 0, is empty",
        ),
        ("bodies:\nrepeat:\n  - for: {i: [1, »N]}\n    BODIES", "the range of i, from 1 to N = 0, is empty"),
        ("bodies: {}\nrepeat:\n  - for: {i: [1, »N]}\n    BODIES", "the range of i, from 1 to N = 0, is empty"),
        ("repeat:\n  - for: {i: [1, N]}\n    joints: {}", "the key 'bodies' is missing"),
    ],
)
def test_a_model_whose_bodies_stand_in_an_empty_range_is_told_which(text, said):
    model = "mbstab: 1\ncounts: {N: 0}\n" + text.replace("BODIES", "bodies: {b<i>: {type: point, mass: 1}}")
    line = model.partition("»")[0].count("\n") + 1
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(model.replace("»", ""), name="chain")
    assert said in str(caught.value)
    assert "»" not in model or caught.value.problems[0].location.line == line


def test_one_fault_in_many_repetitions_is_told_once():
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(CHAIN.replace("mass: m}", "mas: m}").replace("COUNT", "50"))
    assert str(caught.value).count("unknown key 'mas'") == 1


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "loops", ["{i: [1, 100000], j: [1, 100000]}", "{i: [1, 200000]}, bodies: {b<i>: {type: planar_point, mass: 1}}"]
)
def test_floods_are_refused(loops):
    with pytest.raises(ModelFileError, match=f"more than {MAX_NODES} nodes"):
        mbstab.loads(f"mbstab: 1\nrepeat:\n  - {{for: {loops}}}\n")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("k: stiff", "kk: stiff", r"car\.yaml:8:\d+: include\.with: the part has no parameter and no need 'kk'"),
        ("mount: chassis, k", "k", r"car\.yaml:8:5: include: the part needs 'mount'"),
        ("file: wheel.yaml, prefix: front_", "file: wheal.yaml, prefix: f_", r"car\.yaml:8:12: .*cannot be read"),
        ("prefix: rear_", "prefix: front_", r"wheel\.yaml:9:3: bodies\.front_hub: the name 'front_hub' is there"),
        ("prefix: rear_", "prefix: 3", r"'3' cannot begin a name"),
        ("wheel.yaml, prefix: rear_", "car.yaml, prefix: rear_", r"car\.yaml includes itself: car\.yaml → car\.yaml"),
        ("wheel.yaml, prefix: rear_", "../car.yaml", r"is not the name of a file in the folder of the model"),
        ("{mount: chassis}", "{mount: chasis}", r"wheel\.yaml:17:\d+: .*chasis.*included in .*car\.yaml:8"),
        ("wheel.yaml, prefix: rear_", "., prefix: rear_", r"car\.yaml:9:\d+: include\.file: "),
    ],
)
def test_bad_parts_are_refused_where_they_stand(car, old, new, message):
    car.write_text(CAR.replace(old, new), encoding="utf-8")
    with pytest.raises(ModelFileError, match=message):
        mbstab.load(car)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass: m}", "mass: m**}", r"wheel\.yaml:9:\d+: bodies\.front_hub\.mass: .*included in .*car\.yaml:8:12"),
        ("  m: 3", "  sin: 3\n  m: 3", r"wheel\.yaml:6:3: parameters: 'sin' is a word of the file format"),
        ("title:", "gravity: [0, -9]\ntitle:", r"wheel\.yaml:2:1: gravity: the section 'gravity' cannot be included"),
        ("bodies:", "bodies: {", r"wheel\.yaml:\d+:\d+: not valid YAML"),
    ],
)
def test_faults_in_parts_are_told_with_the_place_in_the_part(car, old, new, message):
    (car.parent / "wheel.yaml").write_text(WHEEL.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ModelFileError, match=message):
        mbstab.load(car)


def test_a_part_alone_says_that_it_is_one(car):
    with pytest.raises(ModelFileError, match=r"wheel\.yaml:3:1: this is a part of a model: it needs mount"):
        mbstab.load(car.parent / "wheel.yaml")


def test_parts_that_include_each_other_end(tmp_path):
    for one, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{one}.yaml").write_text(
            f"mbstab: 1\ninclude: {{file: {other}.yaml, prefix: {one}_}}\n", encoding="utf-8"
        )
    with pytest.raises(MbstabError, match=r"b\.yaml includes itself: b\.yaml → a\.yaml → b\.yaml"):
        mbstab.load(tmp_path / "a.yaml")


def test_included_files_are_not_overwritten(car):
    (car.parent / "grip.csv").write_text("x,y\n-1,-1\n0,0\n1,1\n", encoding="utf-8")
    (car.parent / "wheel.yaml").write_text(
        WHEEL.replace("ground:", "tables: {grip: {file: grip.csv}}\nground:").replace("S: 1", "S: 1"), encoding="utf-8"
    )
    for name in ("grip.csv", "wheel.yaml"):
        before = (car.parent / name).read_text(encoding="utf-8")
        result = CliRunner().invoke(
            main, ["eig", str(car), "--format", "csv" if name == "grip.csv" else "json", "-o", str(car.parent / name)]
        )
        assert result.exit_code == 2
        assert (car.parent / name).read_text(encoding="utf-8") == before


def test_work_that_is_taken_up_again_knows_the_parts(car):
    """With another part the answer is computed anew."""
    out = car.parent / "k.csv"
    call = ["sweep", str(car), "--param", "stiff", "--from", "100", "--to", "200", "--points", "3", "-o", str(out)]
    assert CliRunner().invoke(main, call).exit_code == 0
    first = out.read_text(encoding="utf-8")
    (car.parent / "wheel.yaml").write_text(WHEEL.replace("m: 3", "m: 5"), encoding="utf-8")
    again = CliRunner().invoke(main, [*call, "--resume"])
    assert again.exit_code == 2 or out.read_text(encoding="utf-8") != first


def test_a_count_is_set_like_a_parameter(tmp_path):
    written = mbstab.loads(CHAIN.replace("COUNT", "5")).eig(m=3).values()
    model = mbstab.loads(CHAIN.replace("COUNT", "2"))
    for chain in (model.at(N=5, m=3), model.at(m="3").at(N="5"), model.at(N=5).at(m=3)):
        assert np.array_equal(chain.eig().values(), written)
    file = tmp_path / "chain.yaml"
    file.write_text(CHAIN.replace("COUNT", "2"), encoding="utf-8")
    ran = CliRunner().invoke(main, ["eig", str(file), "--set", "N=5", "--set", "m=3", "--format", "json"])
    assert json.loads(ran.output)["counts"]["expected"] == 10
    values = np.linspace(50.0, 150.0, 300)
    sweeps = [mbstab.load(file).at(N=4).sweep("k", values, jobs=jobs).branches for jobs in (1, 2)]
    assert np.array_equal(*sweeps)
    assert sweeps[0].shape[1] == 8


@pytest.mark.parametrize("value", ["2.5", "-1", "m", "", "1e1"])
def test_a_count_that_is_no_whole_number_is_refused(value):
    with pytest.raises(UsageError, match="N is a count of the file: expected a whole number"):
        mbstab.loads(CHAIN.replace("COUNT", "2")).eig(N=value)


def test_a_parameter_of_a_part_with_a_reserved_name_is_refused_also_where_it_is_set(tmp_path):
    part = "mbstab: 1\nneeds: {mount: a body}\nparameters: {x: 2}\nbodies: {b: {type: planar_point, mass: x}}\n"
    (tmp_path / "part.yaml").write_text(part, encoding="utf-8")
    top = "mbstab: 1\nbodies: {a: {type: planar_point, mass: 1}}\n"
    top += "include: [{file: part.yaml, prefix: r_, with: {mount: a, x: 4}}]\n"
    (tmp_path / "top.yaml").write_text(top, encoding="utf-8")
    with pytest.raises(ModelFileError, match="'x' is a word of the file format"):
        mbstab.load(tmp_path / "top.yaml")


CONTROLLED = """\
mbstab: 1
parameters: {m: 2, k: 18, c: 0.4, frame: 2*c}
ground: {directions: {up: [3, 4]}}
bodies: {mass: {type: planar, mass: m, inertia: 1, directions: {m: [1, 0]}}}
definitions: {motion: k*displacement(slide)}
joints:
  slide: {type: prismatic, between: [mass, ground], axis: [m, up]}
forces:
  hold: {type: state_feedback, joint: slide, gains: {displacement(slide): k, rate(displacement(slide)): frame}}
  filtered: {type: transfer_function, joint: slide, signal: displacement(slide), numerator: [0.1], denominator: [1, 3]}
  act: {type: actuator, joint: slide, effort: 0.5*filtered_1 - motion}
"""

DECOYS = """\
mbstab: 1
parameters: {k: 1, c: 5, frame: 7}
ground: {directions: {up: [0, 1]}}
bodies: {mass: {type: planar, mass: 1, inertia: 1}}
definitions: {motion: 3*displacement(slide)}
joints:
  slide: {type: prismatic, between: [mass, ground], axis: y}
forces:
  filtered: {type: transfer_function, joint: slide, signal: displacement(slide), numerator: [0.2], denominator: [1, 5]}
"""


def test_each_name_of_a_part_is_its_own_where_the_file_has_the_same_names(tmp_path):
    (tmp_path / "controlled.yaml").write_text(CONTROLLED, encoding="utf-8")
    (tmp_path / "decoys.yaml").write_text(DECOYS + "include: {file: controlled.yaml, prefix: own_}\n", encoding="utf-8")
    m, k, c, both = 2.0, 18.0, 0.4, 0.6  # both: 0.1 as the effort of the filter, 0.5 in the actuator
    part = np.array([[0, 1, 0], [-2 * k / m, -2 * c / m, both / m], [1, 0, -3]])
    alone = np.array([[0, 1, 0], [0, 0, 0.2], [1, 0, -5]])
    own = np.concatenate([np.linalg.eigvals(part), np.linalg.eigvals(alone)])
    found = mbstab.load(tmp_path / "decoys.yaml").eig().values()
    assert np.sort_complex(np.round(found, 9)) == pytest.approx(np.sort_complex(np.round(own, 9)), abs=1e-8)


RESERVED = ("dc_motor_arm", "free_rigid_body", "rattleback", "roller_in_ring", "rolling_disk", "rolling_torus",
            "turntable", "von_mises_truss")  # fmt: skip
"""Models with a name that a part cannot have, such as ``body``."""
MODELS = (*installed_models(), *sorted((Path(__file__).parent / "scenes").glob("*.yaml")))


@pytest.mark.parametrize("path", [x for x in MODELS if x.stem not in RESERVED], ids=lambda path: path.stem)
def test_every_name_in_a_part_gets_the_prefix(path, tmp_path):
    """Each model becomes a part of a file without names, where only what got the prefix is found."""
    text = path.read_text(encoding="utf-8").replace("  x: {type: coordinate,", "  shift: {type: coordinate,")
    sections = {x.partition(":")[0]: x for x in re.split(r"^(?=[a-z]+:)", text, flags=re.MULTILINE) if x[:1].isalpha()}
    gravity = re.sub(r"-g\b", "-9.81", sections.get("gravity", ""))
    only_once = ("mbstab", "title", "source", "gravity", "sweep", "expect")
    part = "".join(x for section, x in sections.items() if section not in only_once)
    (tmp_path / "part.yaml").write_text("mbstab: 1\n" + part, encoding="utf-8")
    (tmp_path / "main.yaml").write_text(
        f"mbstab: 1\n{gravity}include: {{file: part.yaml, prefix: the_parts_}}\n", encoding="utf-8"
    )
    (tmp_path / "alone.yaml").write_text(f"mbstab: 1\n{gravity}{part}", encoding="utf-8")
    written, alone = (expanded_text(mbstab.load(tmp_path / x).model) for x in ("main.yaml", "alone.yaml"))
    assert yaml.safe_load(written.replace("the_parts_", "")) == yaml.safe_load(alone)


def test_a_need_that_is_the_ground_has_the_points_of_the_file(tmp_path):
    (tmp_path / "leg.yaml").write_text(
        "mbstab: 1\nneeds: {mount: a body}\nground: {points: {A: [5, 0]}}\nbodies: {p: {type: planar_point, mass: 1}}\n"
        "forces: {s: {type: spring, between: [p, mount.A], stiffness: 4, length: 0}}\n"
        "constraints: {flat: {holonomic: p.y}}\nreference: {coordinates: {p: {x: 1}}}\n",
        encoding="utf-8",
    )
    text = "mbstab: 1\nground: {points: {A: [1, 0]}}\ninclude: {file: leg.yaml, prefix: a_, with: {mount: ground}}\n"
    (tmp_path / "stand.yaml").write_text(text, encoding="utf-8")
    assert mbstab.load(tmp_path / "stand.yaml").eig().values().imag.max() == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("force", "stiffness"), [("<i>**2", 1.0), ("3-<i>", 4.0), ("2*<i>**2*1", 2.0), ("<i-3>**2", 16.0)]
)
def test_a_negative_number_stands_in_brackets(force, stiffness):
    text = (
        "mbstab: 1\nbodies: {p: {type: planar_point, mass: 1}}\nconstraints: {flat: {holonomic: p.y}}\n"
        "repeat: {for: {i: [-1, -1]}, forces: {f: {type: expression, on: {p.x: -(FORCE)*p.x}}}}\n"
    )
    found = mbstab.loads(text.replace("FORCE", force)).eig().values()
    assert found.imag.max() == pytest.approx(np.sqrt(stiffness), rel=1e-14)


def test_a_name_that_ends_in_a_negative_number_is_no_difference():
    text = (
        "mbstab: 1\nparameters: {k: 9}\nbodies: {p: {type: planar_point, mass: 1}}\n"
        "repeat: {for: {i: [0, 0]}, forces: {f: {type: expression, on: {p.x: -k<i-1>*p.x}}}}\n"
    )
    with pytest.raises(ModelFileError, match=r"k\(-1\)|unknown function 'k'"):
        mbstab.loads(text)


def test_a_part_does_not_see_the_indices_of_the_file(tmp_path):
    (tmp_path / "mass.yaml").write_text(
        "mbstab: 1\ncounts: {M: 2*N, N: 1}\nbodies: {p: {type: planar_point, mass: <M>}}\n", encoding="utf-8"
    )
    (tmp_path / "row.yaml").write_text(
        "mbstab: 1\ncounts: {N: 5}\ninclude: {file: mass.yaml, prefix: a_}\n", encoding="utf-8"
    )
    with pytest.raises(ModelFileError, match="there is no count or index 'N'"):
        mbstab.load(tmp_path / "row.yaml")
