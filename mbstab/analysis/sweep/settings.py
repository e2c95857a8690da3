"""How the points of a sweep or a chart are computed: by which processes, and which results are kept."""

from __future__ import annotations

from pathlib import Path

from mbstab.errors import UsageError
from mbstab.records import dataclass


@dataclass(frozen=True)
class SweepSettings:
    """How the points are computed.

    Attributes
    ----------
    directory : Path, optional
        Directory for finished blocks of points; they are removed at the end …
    keep : bool
        … unless they must be kept until the answer is written (`mbstab.analysis.sweep.jobs.discard`).
    resume : bool
        Whether to continue with existing blocks.
    jobs : int
        Number of processes.
    cluster : str
        Address of a Dask scheduler (``tcp://…``) whose workers compute the blocks instead.

    Raises
    ------
    UsageError
        Names all settings that exclude each other.
    """

    directory: Path | None = None
    keep: bool = False
    resume: bool = False
    jobs: int = 1
    cluster: str = ""

    def __post_init__(self) -> None:
        """Refuse settings that exclude each other."""
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
"""In this process, without kept blocks."""
