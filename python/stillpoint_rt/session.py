"""Recorded sessions: topics as structured arrays and as frames."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _native, frames
from .compare import Replay, WhatIf
from .samples import SampleType

if TYPE_CHECKING:
    import pandas as pd

_LAST_NS = 2**64 - 1


class Session(Mapping[str, "Topic"]):
    """A recorded session: a mapping from names of topics to topics.

    `path` is the folder of its parts, or one file. A session that was cut off, or that has topics of another program,
    opens; `gaps` states what is missing.

    A session may keep operators in Python, which are code of someone else: a replay runs them only with `trust`.

    Raises StillpointError: the session cannot be read.
    """

    def __init__(self, path: str | os.PathLike[str], *, trust: bool = False) -> None:
        self.path = Path(path)
        self._native = _native.NativeSession(os.fspath(path), trust)
        about = json.loads(self._native.about())
        self.metadata: dict[str, dict[str, str]] = about["metadata"]
        """Metadata records by name: run, identity of the build and the machine, ports of the topics."""
        self.gaps: list[str] = about["gaps"]
        """What a replay needs and the session does not hold; empty where the session is complete."""
        self.attachments: list[str] = about["attachments"]
        """Names of the files that the session keeps."""
        self.start_ns: int = about["start_ns"]
        """Time of the first activation, ns since the epoch: 0 s of session time."""
        self._topics = {described["name"]: Topic(self, described) for described in json.loads(self._native.topics())}

    def __getitem__(self, name: str) -> Topic:
        try:
            return self._topics[name]
        except KeyError:
            raise KeyError(f"the session has no topic {name!r}; it has {', '.join(self._topics)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._topics)

    def __len__(self) -> int:
        return len(self._topics)

    def __repr__(self) -> str:
        return f"Session({str(self.path)!r}): {len(self)} topics, {'complete' if not self.gaps else 'with gaps'}"

    def topics(self) -> pd.DataFrame:
        """The topics as a frame: operator, type, role, frame of coordinates, samples, bytes. Needs pandas."""
        rows = [
            {
                "topic": t.name, "operator": t.operator, "type": t.type_name.split("@")[0], "role": t.role,
                "frame": t.frame_id, "samples": t.samples, "bytes": t.bytes,
            }
            for t in self.values()
        ]  # fmt: skip
        return frames.pandas().DataFrame(rows).set_index("topic")

    def attachment(self, name: str) -> bytes:
        """The bytes of a file that the session keeps, such as `pipeline.yaml`.

        Raises KeyError: the session keeps no such file.
        """
        found = self._native.attachment(name)
        if found is None:
            raise KeyError(f"the session keeps no file {name!r}; it keeps {', '.join(self.attachments)}")
        return found

    def replay(
        self, *, only: str | None = None, since: str | None = None, record: str | os.PathLike[str] | None = None
    ) -> Replay:
        """Replays the session from its journals and compares every recorded topic byte by byte.

        `only` compares one operator, `since` one operator and all that is downstream of it. `record` is a new folder for
        the session that the replay computes.

        Raises StillpointError: the session keeps no pipeline, an operator is not there, or the folder is in use.
        """
        folder = None if record is None else os.fspath(record)
        return Replay(json.loads(self._native.replay(only, since, folder)))

    def what_if(
        self,
        set: Mapping[str, Any] | Sequence[str] = (),
        *,
        with_pipeline: str | os.PathLike[str] | None = None,
        rerun: Sequence[str] = (),
        hold: Sequence[str] = (),
        latencies: str = "measured",
        align: str = "auto",
        record: str | os.PathLike[str] | None = None,
    ) -> WhatIf:
        """Runs the session again with changes and compares it with the recording.

        `set` has the changes: `{"law.proportional": "3 1/s"}`, or texts as for `--set`. `with_pipeline` is a changed
        pipeline file. `rerun` names operators that run again without a change, `hold` those that are taken from the
        recording. `latencies` is `measured` or `declared`. `record` is a new folder for the session that is computed.

        Raises StillpointError: the changed pipeline has faults (the text names the place), or the session cannot be run.
        """
        if latencies not in ("measured", "declared"):
            raise ValueError(f"invalid latencies: {latencies} (allowed: measured, declared)")
        if isinstance(set, str):
            raise TypeError("`set` is a mapping or a list: write set={'law.proportional': '3 1/s'}")
        sets = [f"{key}={value}" for key, value in set.items()] if isinstance(set, Mapping) else list(set)
        paths = [None if path is None else os.fspath(path) for path in (with_pipeline, record)]
        described = self._native.what_if(
            sets, paths[0], list(rerun), list(hold), latencies == "declared", align, paths[1]
        )
        return WhatIf(json.loads(described))


class Topic:
    """A topic of a session."""

    def __init__(self, session: Session, described: dict[str, Any]) -> None:
        self._session = session
        self.name: str = described["name"]
        self.operator: str = described["operator"]
        self.type_name: str = described["type"]
        """Type of the samples with the hash of its layout, as recorded."""
        self.role: str = described["role"]
        """What the topic is to a replay: `source`, `computed`, `journal` or `measured`."""
        self.frame_id: str | None = described["frame"]
        """Frame of the coordinates."""
        self.samples: int = described["samples"]
        self.bytes: int = described["bytes"]
        self._kind = described["kind"]
        self._type: SampleType | None = None

    @property
    def type(self) -> SampleType:
        """Type of the samples, as this build has it.

        Raises StillpointError: no type of this build fits the recording.
        """
        if self._type is None:
            if self._kind is None:
                text = f"`{self.name}` has samples of type {self.type_name}, which this build cannot read"
                raise _native.StillpointError(text)
            self._type = SampleType._of(self._kind)
        return self._type

    def __len__(self) -> int:
        return self.samples

    def __repr__(self) -> str:
        return f"Topic({self.name!r}): {self.samples} samples of {self.type_name}"

    def array(self, after: float | None = None, until: float | None = None) -> np.ndarray:
        """The samples as a structured array, one row a sample, in the order of recording.

        A row has the fields of `type.dtype`; of a slice that is header and body alone. `after` and `until` bound the
        session time, s.
        """
        return self._read(after, until)[0]

    def elements(self, after: float | None = None, until: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The elements of all samples, and where those of each sample begin.

        Sample `i` has `elements[starts[i]:starts[i + 1]]`. The first array has the dtype `type.element`, the second is
        of int64 with one entry more than there are samples.
        """
        array, elements = self._read(after, until)
        counts = array["count"] if self.type.is_slice else np.ones(len(array), np.int64)
        return elements, np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])

    def frame(self, after: float | None = None, until: float | None = None, *, words: bool = True) -> pd.DataFrame:
        """The samples as a pandas frame, with session time (s) as the index.

        A fixed sample is a row. Diagnostics have a column for each metric. Of other slices each element is a row, with
        the number of the element in the column `element`. Each value of an array has a column of its own, such as
        `position.z`. With `words`, codes and bits are categories of their words; else numbers. `frame.attrs["units"]` has
        the unit of each column. Needs pandas.
        """
        return frames.frame(self, after, until, words)

    def time(self, array: np.ndarray) -> np.ndarray:
        """Session time of the rows of an array, s: their stamps since the first activation."""
        return (array["stamp"].astype(np.int64) - self._session.start_ns) * 1e-9

    def _read(self, after: float | None, until: float | None) -> tuple[np.ndarray, np.ndarray]:
        kind, start = self.type, self._session.start_ns
        first = 0 if after is None else start + round(after * 1e9)
        before = _LAST_NS if until is None else start + round(until * 1e9)
        first, before = (min(max(bound, 0), _LAST_NS) for bound in (first, before))
        meta, elements = self._session._native.read(self.name, first, before)
        meta, elements = meta.view(kind.meta_dtype), elements.view(kind.element)
        if kind.is_slice:
            return meta, elements
        rows = np.empty(len(meta), kind.dtype)
        for whole in (meta, elements):
            for name in whole.dtype.names or ():
                rows[name] = whole[name]
        return rows, elements
