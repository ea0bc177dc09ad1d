"""Two recorded runs side by side: their figures, the differences, and the second one's timeline."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

from mrbt_mesh.core.observer.run_record import RunRecord
from mrbt_mesh.views.replay.shown_recording import ShownRecording

LANES = ("work", "fault", "loss", "unwatched")


@dataclass(frozen=True)
class ComparedFigure:
    """One figure of both runs; None: there is none. `unit`: s, ms, or empty for a number."""

    figure: str
    unit: str
    first: float | None
    second: float | None

    @property
    def difference(self) -> float | None:
        """By how much the second run has more."""
        if self.first is None or self.second is None:
            return None
        return round(self.second - self.first, 6)

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self) | {"difference": self.difference}


def compared(first: RunRecord, second: RunRecord) -> dict[str, Any]:
    """The results, the figures with their differences, and when each first lost a robot."""
    both = [_figures(first), _figures(second)]
    rows = [ComparedFigure(*name, both[0][name], both[1][name]).to_json() for name in both[0]]
    records = (first, second)
    deaths = [each.seconds(each.major[0].at_us) if each.major else None for each in records]
    results = [each.result.name.lower() if each.result else "not over" for each in records]
    return {"results": results, "figures": rows, "first_death_s": deaths}


def _figures(record: RunRecord) -> Mapping[tuple[str, str], float | None]:
    replaced = [f.reassigned_after_us for f in record.major]
    after_ms = sorted(each / 1e3 for each in replaced if each is not None)
    return {
        ("time of the mission", "s"): record.seconds(record.ended_us),
        ("deaths", ""): len(record.major),
        ("deaths without a replacement", ""): replaced.count(None),
        ("replaced after, median", "ms"): median(after_ms) if after_ms else None,
        ("replaced after, longest", "ms"): after_ms[-1] if after_ms else None,
    }


def called(path: Path) -> str:
    """A recording's file with its folder: those of several runs have the same name."""
    return "/".join(path.resolve().parts[-2:])


def beside(shown: ShownRecording, other: ShownRecording) -> dict[str, Any]:
    """What a page needs to draw the other run below the one that it shows; it reads all of both."""
    for each in (shown, other):
        each.read_all()
    lanes: dict[str, list[Any]] = {kind: [] for kind in LANES}
    for key, item in other.changes.since(0).items():
        if (kind := key.partition("/")[0]) in lanes:
            lanes[kind].append(item)
    files = [called(each.playback.player.recording.path) for each in (shown, other)]
    found = compared(shown.whole, other.whole)
    return {"lanes": lanes, **other.to_json(), "files": files, **found}
