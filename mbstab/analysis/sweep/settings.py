"""How the points of a sweep or a chart are computed: by whom, and what is kept on the way."""

from __future__ import annotations

from pathlib import Path

from mbstab.errors import UsageError
from mbstab.records import dataclass


@dataclass(frozen=True)
class SweepSettings:
    """How many points are computed.

    Attributes
    ----------
    directory : Path, optional
        Where finished blocks of points are kept; they are removed in the end …
    keep : bool
        … unless they are needed until the answer is written (`mbstab.analysis.sweep.jobs.discard`).
    resume : bool
        Whether to go on with the blocks that are there.
    jobs : int
        Number of processes.
    cluster : str
        Address of a Dask scheduler (``tcp://…``) whose workers compute instead.

    Raises
    ------
    UsageError
        With all that does not go together.
    """

    directory: Path | None = None
    keep: bool = False
    resume: bool = False
    jobs: int = 1
    cluster: str = ""

    def __post_init__(self) -> None:
        """Check what goes together."""
        problems = []
        if self.jobs > 1 and self.cluster:
            problems.append(
                "--jobs is for processes of this machine, --cluster for those of others: leave out one of them"
            )
        if self.resume and self.directory is None:
            problems.append("--resume goes with --output, beside which the finished parts are kept")
        if problems:
            raise UsageError("\n".join(problems))


HERE = SweepSettings()
"""In this process, nothing kept."""
