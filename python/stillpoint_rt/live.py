"""Runs that go on: live topics, commands, changes of parameters."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from . import _native
from .samples import Sample, SampleType

_LOOK = 0.01


def attach(run: str | int | None = None) -> Run:
    """Joins a run that goes on: by the process number of its supervisor, or the name of its pipeline; without one, the only run.

    Raises StillpointError: there is no such run, or there are several.
    """
    return Run(None if run is None else str(run))


class Run:
    """A run that was joined. It does not know of its readers, and ends without regard to them.

    It belongs to the thread and the process that joined it.
    """

    def __init__(self, run: str | None) -> None:
        self._native = _native.NativeRun(run)
        self._process = os.getpid()
        about = json.loads(self._native.about())
        self.pid: int = about["pid"]
        """Process number of the supervisor."""
        self.pipeline: str = about["pipeline"]
        self.session: Path | None = Path(about["session"]) if about["session"] else None
        """Folder of the session that is recorded."""
        self.topics: dict[str, SampleType] = {t["name"]: SampleType._of(t["kind"]) for t in about["topics"]}
        """Type of the samples of each topic."""

    @property
    def is_going_on(self) -> bool:
        """Whether the run has not ended."""
        return self._native.is_going_on()

    def listen(self, topic: str) -> Listener:
        """Begins to receive a topic: `operator.port`, `operator.journal` or `operator.timing`.

        Samples that are sent from now on are received. A reader that is too slow loses the oldest ones; their sequence
        numbers show it.

        Raises StillpointError: there is no such topic.
        """
        self._check_process()
        return Listener(self, topic)

    def send(self, command: str, *values: float | str) -> str:
        """Sends a command of a person, such as `send("console.target", 0.014)`. It is recorded and replayed.

        Gives the answer in words, as `stillpoint send` prints it.

        Raises StillpointError: it is refused, or is not a command.
        """
        return self._command("send", [], [command, *map(str, values)])

    def set(self, parameter: str, value: Any) -> dict[str, Any]:
        """Changes a live parameter, such as `set("law.proportional", "3 1/s")`. It is recorded and replayed.

        Gives `generation` and `from_activation`, from which the value holds.

        Raises StillpointError: the value is refused.
        """
        return json.loads(self._command("set", ["--json"], [parameter, str(value)]))

    def parameters(self) -> list[dict[str, Any]]:
        """The live parameters, with their values and where each came from."""
        return json.loads(self._command("set", ["--json"], []))

    def _command(self, command: str, options: list[str], arguments: list[str]) -> str:
        # Behind `--`, a negative number is not an option.
        line = [sys.executable, "-m", "stillpoint_rt", command, *options, "--run", str(self.pid), "--", *arguments]
        done = subprocess.run(line, capture_output=True, text=True)
        if done.returncode != 0:
            raise _native.StillpointError((done.stderr + done.stdout).strip())
        return done.stdout.strip()

    def _check_process(self) -> None:
        if os.getpid() != self._process:
            raise RuntimeError("a fork of the process that joined the run cannot use it: call attach() in the new process")

    def __repr__(self) -> str:
        return f"Run({self.pid}): {self.pipeline}, {'going on' if self.is_going_on else 'ended'}"


class Listener:
    """Receives the samples of a topic, each as a copy. An iterator that ends with the run."""

    def __init__(self, run: Run, topic: str) -> None:
        self._run = run
        self.topic = topic
        self._number, described = run._native.listen(topic)
        self.type = SampleType._of(json.loads(described))

    def poll(self) -> Sample | None:
        """The next sample, if it is there."""
        self._run._check_process()
        found = self._run._native.receive(self._number)
        return None if found is None else Sample(self.type, *found)

    def next(self, timeout: float | None = None) -> Sample | None:
        """The next sample; None where the run has ended, or none came within `timeout` seconds."""
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            # Asked before the look: what was sent until the end is received, too.
            goes_on = self._run.is_going_on
            sample = self.poll()
            if sample is not None or not goes_on or (end is not None and time.monotonic() >= end):
                return sample
            time.sleep(_LOOK)

    def take(self, count: int, timeout: float | None = None) -> np.ndarray:
        """The next samples of a fixed type as a structured array with the fields of `type.dtype`: at most `count`.

        Of a slice a row has header and body alone. Fewer come where the run ends, or within `timeout` seconds for all.
        """
        end = None if timeout is None else time.monotonic() + timeout
        rows = np.zeros(count, self.type.dtype)
        for row in range(count):
            sample = self.next(None if end is None else max(0.0, end - time.monotonic()))
            if sample is None:
                return rows[:row]
            for name in rows.dtype.names or ():
                rows[name][row] = sample[name]
        return rows

    def __iter__(self) -> Iterator[Sample]:
        while (sample := self.next()) is not None:
            yield sample
