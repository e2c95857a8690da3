"""The shipped models as plain data, for lists of cases: read once, without mbstab."""

import functools
from pathlib import Path

import yaml

MODELS = Path(__file__).parents[1] / "models"


@functools.cache
def documents():
    """Return the contents of the shipped models by their names."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return {path.stem: yaml.load(path.read_text(encoding="utf-8"), loader) for path in sorted(MODELS.glob("*.yaml"))}
