"""The example models that come with the program."""

from __future__ import annotations

from pathlib import Path

from mbstab.errors import UsageError, nearest, visible
from mbstab.records import dataclass

SUFFIX = ".yaml"

STDIN = "<stdin>"
"""What messages call a model that is read from there."""


@dataclass(frozen=True)
class FoundModel:
    """A model file, and whether it came from the installed examples."""

    path: Path
    installed: bool


def models_folder() -> Path:
    """Return the folder of the example models: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent.parent
    inside = package / "models"
    return inside if inside.is_dir() else package.parent / "models"


def installed_models() -> list[Path]:
    """Return the example models, by name."""
    return sorted(models_folder().glob(f"*{SUFFIX}"))


def starts_folder() -> Path:
    """Return the folder of the commented files with which own models begin, one for each kind."""
    return Path(__file__).resolve().parent / "starts"


def _beside(path: Path) -> list[Path]:
    """Return the model files in the folder of a path."""
    try:
        return sorted(path.parent.glob(f"*{SUFFIX}"))
    except OSError:
        return []


def find_model(name: str) -> FoundModel:
    """Return the file a name stands for: a file, or one of the examples (``pendulum.yaml`` or ``pendulum``).

    Raises
    ------
    UsageError
        If it is neither.
    """
    if not name:
        raise UsageError("the name of the file is empty")
    if "\n" in name:
        raise UsageError("the name of the file has several lines\nhint: mbstab.loads(text) reads the text of a model")
    path = Path(name)
    if visible(name, lines=False) != name:
        raise UsageError(f"{name!r}: the name contains characters that cannot be seen\nhint: rename the file")
    try:
        if path.exists() and not path.is_dir():
            return FoundModel(path, False)
    except (OSError, ValueError) as error:  # the system refuses the name
        raise UsageError(f"{name!r} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if path.name == name:
        example = models_folder() / (name if name.endswith(SUFFIX) else name + SUFFIX)
        if example.is_file():
            return FoundModel(example, True)
    if path.is_dir():
        inside = [model.name for model in sorted(path.glob(f"*{SUFFIX}"))]
        there = ", ".join(inside[:5]) + ", …" * (len(inside) > 5)
        raise UsageError(f"{name} is a folder\nhint: name a model file{f' in it: {there}' if inside else ''}")
    known = {model.stem: model.stem for model in installed_models()} if path.name == name else {}
    known |= {beside.stem: beside.name for beside in _beside(path)}
    near = nearest(path.stem, known)
    hint = f"did you mean {known[near]!r}?" if near else "mbstab models list shows the examples"
    raise UsageError(f"{name}: no such file, and no example model has this name\nhint: {hint}")
