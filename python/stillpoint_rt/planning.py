"""Planning: doses of beams as sparse matrices, the objective of a fluence, and plans.

    case = Case.phantom(0)
    setup = case.setup(grid_mm=10, bixel_mm=10)
    beams = setup.beams([0, 72, 144, 216, 288])
    dose = beams.dose                       # points by bixels, gray per unit weight
    cost, slope = beams.cost(weights)       # the objective of the shipped plans
    beams.plan(weights).dvh()               # what a fluence gives
    beams.solve().dvh()                     # what the shipped solver gives

Lengths are in mm, doses in gray, gantry angles in degrees (IEC 61217).
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _native, frames

if TYPE_CHECKING:
    import pandas as pd


class Case:
    """A patient: image, structures, prescription.

    Volumes are arrays of the shape (z, y, x): x to the patient's left, y to the back, z to the head.
    """

    def __init__(self, native: _native.NativeCase) -> None:
        self._native = native
        about = json.loads(native.about())
        self.name: str = about["name"]
        self.provenance: str = about["provenance"]
        self.fractions: int | None = about["fractions"]
        self.prescription: dict[str, float] = {p["structure"]: p["dose_gy"] for p in about["prescription"]}
        """Prescribed dose of each target, gray."""
        self.shape: tuple[int, ...] = tuple(reversed(about["counts"]))
        """Voxels along z, y, x."""
        self.spacing_mm: tuple[float, ...] = tuple(reversed(about["spacing_mm"]))
        """Distance of voxels along z, y, x, mm."""
        self.origin_mm: tuple[float, ...] = tuple(reversed(about["origin_mm"]))
        """Centre of the first voxel, z, y, x, mm."""
        self._structures = about["structures"]

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Case:
        """The case of a file that `stillpoint case` wrote.

        Raises StillpointError: it cannot be read, or is not a case.
        """
        return cls(_native.NativeCase.read(os.fspath(path)))

    @classmethod
    def phantom(cls, seed: int = 0, site: str = "pelvis") -> Case:
        """A synthetic patient: `pelvis`, `neck` or `lung`. Every seed is another one."""
        return cls(_native.NativeCase.phantom(seed, site))

    def structures(self) -> pd.DataFrame:
        """Role and volume (cm3) of each structure. Needs pandas."""
        return frames.pandas().DataFrame(self._structures).set_index("name")

    @property
    def hu(self) -> np.ndarray:
        """The image, Hounsfield units, int16 of the shape (z, y, x)."""
        return self._native.hu().reshape(self.shape)

    def mask(self, structure: str) -> np.ndarray:
        """Which voxels of the image are in a structure: bool of the shape (z, y, x).

        Raises StillpointError: there is no such structure.
        """
        return self._native.mask(structure).reshape(self.shape)

    def setup(
        self,
        *,
        grid_mm: float = 5.0,
        bixel_mm: float = 10.0,
        objectives: Objectives | None = None,
        angles: int = 90,
        machine: str | os.PathLike[str] | None = None,
        engine: str = "pencil",
        threads: int | None = None,
    ) -> Setup:
        """Makes the case ready for plans: points, objectives, dose engine.

        `grid_mm` is the spacing of the points whose dose is optimised, `bixel_mm` the width of a bixel. `objectives` go
        before those that come with stillpoint. `angles` is the number of angles that a search may use. `machine` is a
        machine file. `engine` is the method by which all doses are computed: `pencil`, or `superposition`, which knows
        lung and air and takes some seconds a beam. Where pencil beams cross lung or air, `notes` of the result says how wrong
        they are. `threads` changes no result.

        Raises StillpointError: a number is out of range, or the objectives do not fit the case.
        """
        return Setup(self, grid_mm, bixel_mm, objectives, angles, machine, engine, threads)

    def __repr__(self) -> str:
        return f"Case({self.name!r}): {len(self._structures)} structures, prescription {self.prescription}"


class Objectives:
    """Objectives of structures, in the words of a table of objectives.

        Objectives().want("Rectum", overdose={"dose": "35 Gy", "weight": 20})

    The first line that fits a structure counts for it. Shapes: overdose, underdose, mean_dose, mean_at_least, dvh_point,
    dvh_at_most, dvh_at_least, geud, fall_off, homogeneity, entry.
    """

    def __init__(self, *, shipped: bool = True, modulation: Mapping[str, float] | None = None) -> None:
        """Without lines. `shipped` lets those that come with stillpoint follow, for structures without a line.
        `modulation` states what uneven fluence costs: `neighbours`, `peaks`, `times_mean`."""
        self.shipped = shipped
        self.modulation = modulation
        self.lines: list[dict[str, Any]] = []

    def want(
        self, *patterns: str, role: str | None = None, cases_with: Sequence[str] | None = None, **shapes: Any
    ) -> Objectives:
        """Adds a line for the structures whose names fit a pattern (`*` for any text), or that have a role. With
        `cases_with` it counts only for cases that have a structure whose name fits one of these patterns.

        Each shape is a mapping with its numbers and units, or a list of them. A line without shapes wants nothing.
        """
        line: dict[str, Any] = {}
        if patterns:
            line["match"] = list(patterns)
        if role is not None:
            line["role"] = role
        if cases_with is not None:
            line["with"] = list(cases_with)
        line["wanted"] = [
            {shape: dict(one)}
            for shape, given in shapes.items()
            for one in ([given] if isinstance(given, Mapping) else given)
        ]
        self.lines.append(line)
        return self

    def to_json(self) -> str:
        """The table as the file of `stillpoint plan --objectives`."""
        table: dict[str, Any] = {"objectives": self.lines}
        if self.modulation is not None:
            table["modulation"] = dict(self.modulation)
        return json.dumps(table, indent=2)


class Setup:
    """A case made ready for plans. See `Case.setup`."""

    def __init__(
        self,
        case: Case,
        grid_mm: float,
        bixel_mm: float,
        objectives: Objectives | None,
        angles: int,
        machine: str | os.PathLike[str] | None,
        engine: str,
        threads: int | None,
    ) -> None:
        self.case = case
        self._native = _native.NativeSetup(
            case._native,
            float(grid_mm),
            float(bixel_mm),
            None if objectives is None else objectives.to_json(),
            objectives is None or objectives.shipped,
            angles,
            None if machine is None else os.fspath(machine),
            engine,
            threads or os.cpu_count() or 1,
        )
        about = json.loads(self._native.about())
        self.points: int = about["rows"]
        """Points: rows of dose matrices."""
        self.notes: list[str] = about["notes"]
        """What people should know of the objectives, and of the doses."""
        self._structures = about["structures"]

    def objectives(self) -> pd.DataFrame:
        """A row for each objective: structure, number of points, the objective in gray. Needs pandas."""
        rows = [
            {"structure": s["structure"], "points": s["rows"], "objective": objective}
            for s in self._structures
            for objective in s["objectives"]
        ]
        return frames.pandas().DataFrame(rows)

    def rows_of(self, structure: str) -> tuple[np.ndarray, np.ndarray]:
        """Rows of dose matrices that are points of a structure with objectives, and the volume that each stands for.

        The unit of the volumes is the voxel of the lattice of points.
        """
        return self._native.rows_of(structure)

    def beams(self, angles: Sequence[float]) -> Beams:
        """The doses of beams at these gantry angles, degrees."""
        return Beams(self, self._native.beams([float(angle) for angle in angles]), angles)

    def dose(self, angles: Sequence[float]) -> Any:
        """The dose matrix of beams at these gantry angles: see `Beams.dose`."""
        return self.beams(angles).dose

    def plan(
        self,
        method: str = "exchange",
        *,
        beams: int = 5,
        budget: int | None = None,
        seed: int = 0,
        priors: Sequence[str] = (),
    ) -> Plan:
        """A plan of a shipped search over the angles of the ring.

        `method` is one of equidistant, class, random, greedy, exchange, annealing, columns, search, prior, construction,
        two-player; `budget` bounds the sets of beams that are solved. Doses of the ring are computed in memory. Ctrl-C is
        obeyed when the search has ended.

        Raises StillpointError: two parts of the request contradict each other.
        """
        angles, weights, cost, history = self._native.plan(method, beams, budget, seed, list(priors))
        return Plan(self.beams(angles), weights, cost, history)


class Beams:
    """The doses of some beams, and the objective of their fluence.

    Weights are of all bixels, beam after beam, and are not negative.
    """

    def __init__(self, setup: Setup, native: _native.NativeBeams, angles: Sequence[float]) -> None:
        self.setup = setup
        self.angles = tuple(float(angle) for angle in angles)
        """Gantry angles, degrees."""
        self._native = native
        self.beam_of, places = native.bixels()
        """Number of the beam of each bixel."""
        self.bixels_mm: np.ndarray = places.reshape(-1, 2)
        """Centres of the bixels on the isocentre plane, x and z in the frame of the beam, mm."""

    def __len__(self) -> int:
        return len(self.beam_of)

    @property
    def csr(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The dose matrix by rows, for programs without scipy: starts of rows, columns, values (float32)."""
        return self._native.dose()

    @cached_property
    def dose(self) -> Any:
        """The dose matrix, points by bixels, gray per unit weight: a `scipy.sparse.csr_array` of float32. Needs scipy."""
        try:
            from scipy.sparse import csr_array
        except ImportError as error:
            raise ImportError(
                "dose matrices need scipy: pip install 'stillpoint-rt[sparse]', or use `csr`"
            ) from error
        starts, columns, values = self.csr
        return csr_array((values, columns, starts), shape=(self.setup.points, len(self)))

    def cost(self, weights: np.ndarray) -> tuple[float, np.ndarray]:
        """The objective of weights and its slope in each: what the shipped solver minimises, modulation included.

        Raises StillpointError: there is not one weight for each bixel.
        """
        return self._native.value(np.ascontiguousarray(weights, np.float64))

    def solve(self) -> Plan:
        """The plan of the shipped solver on these beams."""
        weights, _ = self._native.solve()
        return self.plan(weights)

    def plan(self, weights: np.ndarray) -> Plan:
        """The plan of these weights."""
        weights = np.array(weights, np.float64)
        return Plan(self, weights, self.cost(weights)[0], [])


class Plan:
    """A fluence with what it gives.

    Figures and histograms are of a dose that is computed again on a finer grid than that of the points.
    """

    def __init__(
        self, beams: Beams, weights: np.ndarray, cost: float, history: list[tuple[list[float], float]]
    ) -> None:
        self.beams = beams
        self.weights = weights
        self.cost = cost
        """The objective."""
        self.history = history
        """The sets of angles (degrees) that a search solved, with their objectives."""
        self.grid_mm: float | None = None
        """Spacing of the grid of the figures, mm; None: 2 mm, or finer where the points are."""

    @property
    def angles(self) -> tuple[float, ...]:
        """Gantry angles, degrees."""
        return self.beams.angles

    @cached_property
    def _evaluated(self) -> tuple[dict[str, Any], np.ndarray]:
        levels = [float(gray) for gray in range(10, 80, 10)]
        described, gray = self.beams._native.evaluate(self.weights, levels, self.grid_mm)
        found = json.loads(described)
        return found, gray.reshape(tuple(reversed(found["counts"])))

    @property
    def dose(self) -> np.ndarray:
        """The dose, gray: float32 of the shape (z, y, x) on a grid of its own. See `dose_grid`."""
        return self._evaluated[1]

    @property
    def dose_grid(self) -> dict[str, tuple[float, ...]]:
        """Spacing and origin of `dose`, z, y, x, mm."""
        found = self._evaluated[0]
        return {key: tuple(reversed(found[key])) for key in ("spacing_mm", "origin_mm")}

    def dvh(self) -> pd.DataFrame:
        """Cumulative histograms: the index is a dose (gray), each column the part of a structure that gets at least it."""
        curves = self._evaluated[0]["histograms"]
        columns = {c["structure"]: [volume for _, volume in c["curve"]] for c in curves}
        doses = [dose for dose, _ in curves[0]["curve"]] if curves else []
        return frames.pandas().DataFrame(columns, index=frames.pandas().Index(doses, name="dose_gy"))

    def figures(self) -> pd.DataFrame:
        """Figures of each structure: doses in gray (`d95_gy`), coverage, homogeneity, conformity. Needs pandas."""
        made = frames.pandas().DataFrame(self._evaluated[0]["figures"]).set_index("name")
        return made.drop(columns=["volumes"])

    def __repr__(self) -> str:
        angles = ", ".join(f"{angle:g}" for angle in self.angles)
        return f"Plan: objective {self.cost:.4f}, beams at {angles} degrees"
