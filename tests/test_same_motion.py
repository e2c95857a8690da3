"""A verdict does not depend on how a system is written down, and what stands far away makes it weaker at most."""

import functools
import random
import re
from itertools import product

import pytest
import yaml
from linear_oracle import random_system, text, truth
from sampling import sample
from zoo import SYSTEMS

import mbstab
from mbstab.analysis.verdict.rule import ASYMPTOTIC_UP_TO, STABLE_UP_TO, STRENGTH, UNDECIDED
from mbstab.errors import MbstabError

SECTIONS = ("bodies", "joints", "constraints", "contacts", "drives", "forces")
KEYS = {"x", "y", "z", "phi", "theta", "psi"}
NAMES = [system.name for system in SYSTEMS]
TEXTS = {system.name: system.text for system in SYSTEMS}


def verdict(document):
    """Return the verdict, open where the model is refused: a refusal claims nothing."""
    model = document if isinstance(document, str) else yaml.safe_dump(document, sort_keys=False)
    try:
        result = mbstab.loads(model).eig()
    except MbstabError:
        return UNDECIDED
    # Where nothing is left to judge, all of it decays as well.
    nothing = result.verdict == STABLE_UP_TO and result.counts.neutral == result.counts.found
    return ASYMPTOTIC_UP_TO if nothing else result.verdict


def exchanged(document):
    """Write all entries of all sections the other way round."""
    return {key: dict(reversed(x.items())) if key in SECTIONS else x for key, x in document.items()}


def renamed(document):
    """Give all bodies other names, in another alphabetical order."""
    names = {name: f"{'zyxwv'[k % 5]}_{k}_body" for k, name in enumerate(document["bodies"])}

    def changed(x, key=""):
        if isinstance(x, dict):
            return {names.get(k, changed(k)): changed(y, k) for k, y in x.items()}
        if isinstance(x, list):
            return [changed(y, key) for y in x]
        if not isinstance(x, str) or key in ("title", "source", "description", "type"):
            return x
        return names.get(x, re.sub(r"(?<![\w.])(\w+)(?=\.)", lambda m: names.get(m[1], m[1]), x))

    return changed(document)


def beside(damping):
    """Return what adds a heavy oscillator far away."""

    def changed(document):
        planar = any("planar" in str(body.get("type", "")) for body in document["bodies"].values())
        others = "y" if planar else "yz"
        found = {key: dict(x) if isinstance(x, dict) else x for key, x in document.items()}
        found["bodies"]["far"] = {"type": "planar_point" if planar else "point", "mass": "1e6"}
        law = f"-2e6*(far.x - 1000) - {damping}*rate(far.x)"
        found.setdefault("forces", {})["far"] = {"type": "expression", "on": {"far.x": law}}
        rows = {f"far_{k}": {"holonomic": f"far.{k} - 50"} for k in others}
        found["constraints"] = {**found.get("constraints", {}), **rows}
        reference = dict(found.get("reference", {}))
        places = {"x": 1000, **dict.fromkeys(others, 50)}
        reference["coordinates"] = {**reference.get("coordinates", {}), "far": places}
        found["reference"] = reference
        return found

    return changed


CHANGES = {
    "exchanged": exchanged,
    "renamed": renamed,
    "beside an oscillator": beside("0"),
    "beside a damped oscillator": beside("1e5"),
}


@functools.cache
def known(name):
    """Return the verdict on a system as it is written in the zoo."""
    return verdict(TEXTS[name])


@pytest.mark.parametrize(("name", "change"), sample(product(NAMES, CHANGES), 9))
def test_the_verdict_is_the_same_or_weaker(name, change):
    # All as texts: they are expressions.
    document = yaml.load(TEXTS[name], Loader=yaml.BaseLoader)
    before, after = known(name), verdict(CHANGES[change](document))
    assert after in STRENGTH[before] or before in STRENGTH[after]
    if change in ("exchanged", "renamed"):
        assert after == before
    else:
        assert after in STRENGTH[before]


def scaled(rng, K, D):
    """Return K and D in other units of each coordinate and of time."""
    n = len(K)
    units, time = [3.7 ** rng.randint(-3, 3) for _ in range(n)], 1.7 ** rng.randint(-3, 3)
    return (
        [[K[i][j] * time**2 * units[j] / units[i] for j in range(n)] for i in range(n)],
        [[D[i][j] * time * units[j] / units[i] for j in range(n)] for i in range(n)],
    )


@pytest.mark.parametrize(("seed", "systems"), sample([(8, 30), (8, 150)], 2))
def test_units_change_no_verdict_on_a_linear_system_but_to_a_weaker_one(seed, systems):
    rng, same = random.Random(seed), 0
    for _ in range(systems):
        K, D = random_system(rng, rng.randint(1, 4))
        known, before = truth(K, D), verdict(text(K, D))
        after = verdict(text(*scaled(rng, K, D)))
        assert after in known.allowed, (K, D)
        assert after in STRENGTH[before], (K, D)
        same += after == before
    assert same >= 0.8 * systems
