"""Operators in Python.

    # ops/speed.py
    from stillpoint_rt.operator import Input, Operator, Output, Param

    class Smooth(Operator):
        \"\"\"Smooths the position of a track.\"\"\"

        track = Input("Track", queue=4)
        smooth = Output("Track", frame_of="track")
        share = Param(0.5, min=0, max=1, about="Share of the new position.")

        def start(self):
            self.position = None

        def step(self, activation):
            track = activation.fresh("track")
            if track is None:
                return
            new = track["position"]
            old = new if self.position is None else self.position
            self.position = old + self.share * (new - old)
            activation.send("smooth", track, position=self.position)

In the pipeline it is `use: ops/speed.py:Smooth`. What `step` sends may depend on the parameters, on the state that earlier
steps left, and on the activation; on nothing else: no clock, no file, no random numbers but `activation.random()`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._runner import Activation


@dataclass(frozen=True)
class Input:
    """An input port. Its name is that of the attribute."""

    sample: str
    """Type of the samples."""
    queue: int | None = None
    """Most samples that wait; each is taken by one step. None: the newest sample, held from step to step."""
    required: bool = True
    """Whether the pipeline must connect it."""
    about: str = ""


@dataclass(frozen=True)
class Output:
    """An output port. Its name is that of the attribute."""

    sample: str
    """Type of the samples."""
    frame_of: str | None = None
    """The input whose frame the samples have."""
    framed: bool = False
    """Whether `frame:` of the pipeline names the frame."""
    capacity: int | str = 1
    """Most elements of a sample, or the parameter that states them. Shared memory is laid out by it."""
    about: str = ""


@dataclass(frozen=True)
class Param:
    """A parameter. Its name is that of the attribute, which has its value in an operator.

    A number is a float, and SI where it has a unit; an int with a unit is a count of that unit.
    """

    default: float | int | bool | str | None = None
    """None: the pipeline must give it."""
    type: type | None = None
    """float, int, bool or str; needed where there is no default."""
    unit: str = ""
    min: float | int | None = None
    max: float | int | None = None
    choices: tuple[str, ...] = ()
    """The texts that it may be."""
    about: str = ""


class Operator:
    """A deterministic step machine. Derive from it, and declare ports and parameters as attributes of the class."""

    timer = "optional"
    """Whether the pipeline gives `every`: `no`, `optional` or `required`."""

    name: str
    """Name of the operator in the pipeline."""
    every: int | None
    """Period of its timer, ns."""

    def start(self) -> None:
        """Called once, before the first step of an incarnation, with the parameters set."""

    def step(self, activation: Activation) -> Any:
        """Does one activation.

        Arrays of inputs are read-only, and their memory is given back after the step: store copies.
        """
        raise NotImplementedError
