"""Eigenvalues of models to 50 digits and more: computed once by `elimination`, stored in ``truths/eigenvalues.jsonl``.

A truth belongs to the text of a model. Where a model or its parameters change, ``python tests/truths/make.py`` computes
what is missing.
"""

import functools
import json
from pathlib import Path

import mpmath
import numpy as np
from elimination import eliminated
from mpmath import mp
from scipy.optimize import linear_sum_assignment

from mbstab.model.library import installed_models, models_folder
from mbstab.model.reader import read_model_text

DIGITS = 50
WORKING_DIGITS = 90
STORED_DIGITS = 80
ZERO = 1e-15
"""Zero eigenvalues in Jordan blocks of size 5 come out as 1e-90 to the power 1/5; others are larger than this."""

STORE = Path(__file__).parent / "truths" / "eigenvalues.jsonl"


def exact_eigenvalues(model, zero=ZERO, digits=WORKING_DIGITS, **parameters):
    """Return the eigenvalues of a model that are not neutral, as mpmath numbers, and how many are neutral.

    Parameters are texts in SI units, all else is said by `elimination.eliminated`.
    """
    question = asked(model, zero, digits, parameters)
    answer = lookup(question)
    with mp.workdps(WORKING_DIGITS):
        return [number(parts) for parts in answer["eigenvalues"]], answer["neutral"]


def asked(model, zero, digits, parameters):
    """Return all on which a truth depends; shipped models go by their names."""
    text = "\n".join(model.document.lines)
    return {"model": shipped().get(text, text), "zero": zero, "digits": digits, "parameters": parameters}


def lookup(question):
    """Return what is stored; `truths/make.py` puts a function here that computes what is not."""
    answer = stored().get(key(question))
    assert answer is not None, f"no truth is stored for {question}: python tests/truths/make.py"
    return answer


def computed(question):
    """Return the answer to a question, computed now."""
    name = question["model"]
    text = (models_folder() / name).read_text(encoding="utf-8") if "\n" not in name else name
    model = read_model_text(text, "model.yaml")
    values, neutral = eliminated(model, question["zero"], question["digits"], question["parameters"])
    with mp.workdps(WORKING_DIGITS):
        return {"neutral": neutral, "eigenvalues": [parts_of(value) for value in values]}


def number(parts):
    """Return a number from its real part, and its imaginary part where it has one."""
    return mp.mpc(*parts) if len(parts) == 2 else mp.mpf(parts[0])


def parts_of(value):
    """Return what `number` reads."""
    parts = (value.real, value.imag) if isinstance(value, mpmath.mpc) else (value,)
    return [mp.nstr(part, STORED_DIGITS) for part in parts]


def key(question):
    """Return a question as a text."""
    return json.dumps(question, sort_keys=True, ensure_ascii=False)


@functools.cache
def stored():
    """Return the answers by their questions."""
    found = {}
    for line in STORE.read_text(encoding="utf-8").splitlines():
        question, answer = json.loads(line)
        found[key(question)] = answer
    return found


@functools.cache
def shipped():
    """Return the names of the shipped models by their texts."""
    return {"\n".join(path.read_text(encoding="utf-8").split("\n")): path.name for path in installed_models()}


def distance(found, exact):
    """Return |found − exact| after optimal pairing, and the exact values in the order of `found`, as floats."""
    rough = np.array([complex(value) for value in exact])
    found = np.asarray(found, dtype=complex)
    i, j = linear_sum_assignment(np.abs(found[:, None] - rough[None, :]))
    with mp.workdps(DIGITS):
        errors = np.array(
            [float(abs(mpmath.mpmathify(complex(found[a])) - exact[b])) for a, b in zip(i, j, strict=True)]
        )
    return errors, rough[j]
