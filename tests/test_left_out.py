"""Shipped models from which one part is left out: answered or refused, and nothing else happens."""

from pathlib import Path

import pytest
import yaml
from sampling import sample

import mbstab
from mbstab.errors import MbstabError

MODELS = Path(__file__).parents[1] / "models"
SECTIONS = ("joints", "constraints", "contacts", "forces", "drives", "controllers", "motors", "states", "reference")

ONCE_WRONG = ("motorcycle.yaml", "joints", "front_axle")
"""A massless wheel that slides in a moving reference, tied to the state of its tyre."""


def parts():
    """Return model, section and name of everything that may be left out."""
    found = []
    for path in sorted(MODELS.glob("*.yaml")):
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        found += [(path.name, s, name) for s in SECTIONS for name in data.get(s, {})]
    return found


@pytest.mark.parametrize(
    ("model", "section", "name"), sample([ONCE_WRONG, *(part for part in parts() if part != ONCE_WRONG)], 8)
)
def test_a_model_without_one_of_its_parts_is_answered_or_refused(model, section, name):
    data = yaml.safe_load((MODELS / model).read_text(encoding="utf-8"))
    del data[section][name]
    data.pop("expect", None)
    text = yaml.safe_dump(data, sort_keys=False)
    try:
        mbstab.loads(text).eig()
    except MbstabError as error:
        assert str(error)  # noqa: PT017 (an answer is as good)
