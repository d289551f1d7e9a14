"""Steps of an operator: from the bytes of its inputs to the bytes of its outputs."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ._describe import Fault, declarations, explain, load
from .operator import Input, Output
from .samples import Sample, SampleType, sample_types


class Activation:
    """One activation: the only thing that enters a step."""

    __slots__ = ("_inputs", "_key", "_runner", "_sent", "cause", "finished", "index", "nominal", "origin", "tick", "time")

    def __init__(self, runner: Runner, moment: tuple[int, ...], port: str | None, inputs: list[Any], key: Any) -> None:
        self._runner = runner
        self.index, self.time, self.nominal, self.tick, self.origin = moment
        """Number of the activation; its time, the time at which it was due, and the acquisition time of the oldest sensor
        sample behind it, ns since the epoch; number of the tick of the timer."""
        self.cause = port or "timer"
        """The input that caused it, or `timer`."""
        self._inputs = dict(zip(runner.inputs, inputs, strict=True))
        self._key = key
        self._sent: list[tuple[int, np.ndarray, np.ndarray]] = []
        self.finished = False

    def _input(self, name: str) -> Any:
        if self._inputs is None:
            raise RuntimeError("this activation is over: copy what a later step needs")
        try:
            return self._inputs[name]
        except KeyError:
            raise KeyError(f"there is no input {name!r}; there are {', '.join(self._inputs)}") from None

    def __getitem__(self, name: str) -> Sample | None:
        """The sample on an input, held ones included. None where there is none."""
        arrays, _, _, _ = self._input(name)
        return None if arrays is None else Sample(self._runner.inputs[name], *arrays)

    def fresh(self, name: str) -> Sample | None:
        """The sample on an input that no earlier step has seen."""
        _, held, _, _ = self._input(name)
        return None if held else self[name]

    def missed(self, name: str) -> int:
        """Samples on an input that were sent and never taken since the last activation."""
        return self._input(name)[2]

    def restarted(self, name: str) -> bool:
        """Whether the producer of an input was restarted since the last activation."""
        return self._input(name)[3]

    def random(self) -> np.random.Generator:
        """Random numbers of this activation: the same in each run with the same seed. Each call begins anew."""
        seed, operator, incarnation = self._key
        key = hashlib.blake2b(struct.pack("<QQIQ", seed, operator, incarnation, self.index), digest_size=16)
        return np.random.Generator(np.random.Philox(key=int.from_bytes(key.digest(), "little")))

    def send(self, name: str, like: Any = None, **fields: Any) -> None:
        """Sends a sample, as a copy.

        `like` is a sample of the same type, or an array of elements. `fields` are set by name: of the body, of the element of
        a fixed sample, or of all elements of a slice. What is not given is zero.
        """
        if self._inputs is None:
            raise RuntimeError("this activation is over: nothing can be sent")
        try:
            number, kind = self._runner.outputs[name]
        except KeyError:
            raise KeyError(f"there is no output {name!r}; there are {', '.join(self._runner.outputs)}") from None
        meta = np.zeros(1, kind.meta_dtype)
        before = sum(1 for sent, _, _ in self._sent if sent == number)
        elements = _elements(kind, like, fields, lambda count: self._runner.room(number, before, count))
        if isinstance(like, Sample):
            for field in kind.head:
                meta[field.name] = like._meta[field.name]
        for field, value in fields.items():
            if field in (elements.dtype.names or ()):
                elements[field] = value
            elif field in (meta.dtype.names or ()) and field not in _HEADER:
                meta[field] = value
            elif not (field == "data" and elements.dtype.names is None):
                raise KeyError(f"{kind.name} has no field {field!r}")
        meta["count"] = len(elements)
        if "length" in (meta.dtype.names or ()):
            meta["length"] = len(elements)
        self._sent.append((number, meta.view(np.uint8), elements.view(np.uint8).reshape(-1)))

    def finish(self) -> None:
        """States that the operator has no more samples of its own: its timer stops."""
        self.finished = True

    def _close(self) -> None:
        self._inputs = None


_HEADER = ("stamp", "origin", "sequence", "incarnation", "count")


def _elements(
    kind: SampleType, like: Any, fields: Mapping[str, Any], room: Callable[[int], np.ndarray]
) -> np.ndarray:
    """The elements of a sample that is sent: a copy of `like` in `room`, or as many as its fields have."""

    def copied(given: np.ndarray) -> np.ndarray:
        copy = room(given.size)
        copy[:] = given.reshape(-1)
        return copy

    if isinstance(like, Sample):
        if like.type.type_name != kind.type_name:
            raise TypeError(f"the output sends {kind.name}, not {like.type.name}")
        return copied(like.elements)
    if like is not None:
        given = np.ascontiguousarray(like, kind.element)
        return copied(given) if given is like else given.reshape(-1)
    if not kind.is_slice:
        return np.zeros(1, kind.element)
    if kind.element.names is None:
        return np.array(fields.get("data", ()), kind.element).reshape(-1)
    counts = {len(value) for field, value in fields.items() if field in kind.element.names}
    if len(counts) > 1:
        raise ValueError(f"the fields of the elements have {sorted(counts)} values: give the same number of each")
    return np.zeros(counts.pop() if counts else 0, kind.element)


# Samples of an output in one step whose memory later steps use again.
_ROOMS = 4


class Runner:
    """An operator object with its ports."""

    def __init__(self, name: str, sources: Mapping[str, bytes], params: dict[str, Any], about: dict[str, Any]) -> None:
        found, _ = load(name, sources)
        self._sources = sources
        types = sample_types()
        declared = declarations(found)
        self.inputs = {key: types[v.sample] for key, v in declared.items() if isinstance(v, Input)}
        outputs = [(key, types[v.sample]) for key, v in declared.items() if isinstance(v, Output)]
        self.outputs = {key: (number, kind) for number, (key, kind) in enumerate(outputs)}
        self._rooms: list[list[np.ndarray]] = [[np.empty(0, kind.element)] * _ROOMS for _, kind in outputs]
        code = found.step.__code__
        self.place = f"{code.co_filename}:{code.co_firstlineno}, in step"
        self.object = found.__new__(found)
        for key, value in {**params, **about}.items():
            setattr(self.object, key, value)
        self.object.__init__()
        self.object.start()

    def step(self, moment: tuple[int, ...], port: str | None, inputs: list[Any], key: Any) -> tuple[Any, bool]:
        """Does one activation; gives what it sends, and whether the operator has finished."""
        activation = Activation(self, moment, port, inputs, key)
        try:
            self.object.step(activation)
        finally:
            activation._close()
        return activation._sent, activation.finished

    def room(self, output: int, before: int, count: int) -> np.ndarray:
        """Memory for the elements of a sample that a step sends, after `before` others on this output. What is sent is copied
        out of it before the next step, which uses it again: fresh pages cost more than a copy."""
        rooms = self._rooms[output]
        if before >= _ROOMS:
            return np.empty(count, rooms[0].dtype)
        if len(rooms[before]) < count:
            rooms[before] = np.empty(count, rooms[0].dtype)
        return rooms[before][:count]

    def explain(self, error: BaseException) -> str:
        """An exception in words, with its place in the source."""
        return explain(error, self._sources)


def make(
    name: str,
    sources: Mapping[str, bytes],
    params: str,
    operator: str,
    every: int | None,
    connected: list[bool],
    input_frames: list[str | None],
    output_frames: list[str | None],
) -> Runner | str:
    """The runner of an operator, or why there is none."""
    about = {
        "name": operator,
        "every": every,
        "connected": connected,
        "input_frames": input_frames,
        "output_frames": output_frames,
    }
    try:
        return Runner(name, sources, json.loads(params), about)
    except Fault as fault:
        return str(fault)
    except Exception as error:
        return explain(error, sources)
