"""Results of replays, of what-if runs, and of comparisons of sessions."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from . import _native, frames

if TYPE_CHECKING:
    import pandas as pd

    from .session import Session


class Replay:
    """The result of a replay."""

    def __init__(self, report: dict[str, Any]) -> None:
        self.report = report
        """All of it, as `stillpoint replay --json` prints it."""
        self.verdict: str = report["verdict"]
        """The result in one sentence."""
        self.identical: bool = report["identical_all"]
        """Whether the session is complete, all of it was replayed, and all that could be compared is the same."""
        self.differences: int = report["differences"]
        """Samples that differ."""
        self.first_difference: dict[str, Any] | None = report["first_difference"]

    def __repr__(self) -> str:
        return f"Replay: {self.verdict}"


class Comparison:
    """How two sessions differ, topic by topic and field by field."""

    def __init__(self, found: dict[str, Any], identical: bool, names: tuple[str, str]) -> None:
        self.found = found
        """All of it, as `stillpoint diff --json` prints it."""
        self.identical = identical
        """Whether both sessions are the same, to the bit."""
        self.names = names
        """Names of the two sessions, for the columns of `figures`."""

    @property
    def changed(self) -> list[str]:
        """Topics that differ."""
        return [topic["topic"] for topic in self.found["topics"] if not topic["identical"]]

    @property
    def unchanged(self) -> list[str]:
        """Topics that are the same, to the bit."""
        return [topic["topic"] for topic in self.found["topics"] if topic["identical"]]

    @property
    def first(self) -> dict[str, Any] | None:
        """The first difference: `topic`, `at_s` (session time, s), `field`."""
        return self.found["first"]

    def table(self) -> pd.DataFrame:
        """A row for each field that differs: `unit`, samples that differ, `since_s` (s), `rms`, `worst`, `worst_s`, `trend`."""
        rows = [
            {"topic": topic["topic"], **{key: field.get(key) for key in _COLUMNS}}
            for topic in self.found["topics"]
            for field in topic["fields"]
        ]
        return frames.pandas().DataFrame(rows, columns=["topic", *_COLUMNS]).set_index(["topic", "field"])

    def figures(self) -> pd.DataFrame:
        """The figures at the end of both runs, a column for each run, with `unit`."""
        rows = [
            {"figure": f["name"], "unit": f["unit"], **dict(zip(self.names, f["values"], strict=True))}
            for f in self.found["figures"]
        ]
        columns = ["figure", "unit", *self.names]
        return frames.pandas().DataFrame(rows, columns=columns).set_index("figure")

    def __repr__(self) -> str:
        if self.identical:
            return f"{type(self).__name__}: identical to the bit"
        return f"{type(self).__name__}: {len(self.changed)} topics differ, {len(self.unchanged)} do not"


_COLUMNS = ["field", "unit", "samples", "since_s", "rms", "worst", "worst_s", "trend"]


class WhatIf(Comparison):
    """The result of a session that ran again with changes, against its recording."""

    def __init__(self, answer: dict[str, Any]) -> None:
        super().__init__(answer["comparison"], answer["identical_all"], ("recorded", "changed"))
        self.answer = answer
        """All of it, as `stillpoint replay --set --json` prints it."""
        self.computed: list[str] = answer["computed"]
        """Operators that ran again."""
        self.closed_loop: list[str] = answer["closed_loop"]
        """Simulated patients that ran again and so reacted to the change; empty in an open loop."""
        self.changes: list[Any] = answer["changes"]


def diff(first: Session, second: Session, *, align: str = "auto") -> Comparison:
    """Compares two sessions.

    `align` pairs samples by `sequence`, by `origin` (time of acquisition), or `auto`: by origin where the sessions share at
    least half of these times.

    Raises StillpointError: a sample cannot be read.
    """
    found = json.loads(_native.diff(first._native, second._native, align))
    return Comparison(found, found["identical_all"], ("first", "second"))
