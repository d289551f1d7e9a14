"""The fluence of a plan by a public Monte Carlo program, beside the dose that stillpoint reports.

    python -m venv /tmp/mc && /tmp/mc/bin/pip install pyradmc==0.2.1 warp-lang==1.19.0 pydicom
    stillpoint plan patient.case --angles 0,72,144,216,288 --engine superposition --fluence-only --dose-grid 5mm --out plan
    /tmp/mc/bin/python stages/planning/plan/benches/monte_carlo.py patient.case plan MACHINE.json 100 2 0.9753

The arguments are the case, the folder of its plan, the machine file (`stages/planning/plan/data/generic_6mv.json` is the
shipped one), millions of photons, processes, and the output of the calibration field (below; default 1). `plan.json` must be without leaves and couch angles, and the patient head
first and supine. Tissue is water of the density that the machine file gives, as in stillpoint; outside of the patient is air.

Electrons scatter by the law that is the program's default; its tables take some minutes at the beginning. The kernels of the
machine file were made with a simpler law of the same program, and with its cross sections.
The output of a machine is calibrated in the field of 100 mm, 100 mm deep in water: there stillpoint has 1 Gy for a weight of 1.

    /tmp/mc/bin/python stages/planning/plan/benches/monte_carlo.py calibration MACHINE.json 60

prints what the Monte Carlo program has there. Differences are printed photon for photon, and unit for unit: over that output.

Photons leave a point source through the blurred squares of the bixels. The spectrum is that of the kernels, and the unit is
absolute: nothing is scaled to fit. The noise of D98 and D2 is taken out by extrapolation from half of the photons to all.
"""

import json
import multiprocessing
import pathlib
import struct
import sys
import zlib

import numpy as np
import pydicom
from pyradmc import AnalyticCrossSections, InMemoryPhaseSpaceSource, VoxelGrid, WarpEngine, ali_rogers_mv
from pyradmc.scoring.grid import ScoringGrid

BEAM, AIR = "varian-6mv", 0.0012
CHUNK = 2_000_000
MARGIN_MM = 20.0


def read_case(path):
    """Header, Hounsfield units and masks, as arrays with x first."""
    data = pathlib.Path(path).read_bytes()
    assert data[:8] == b"SPCASE01", "not a case file"
    (length,) = struct.unpack_from("<I", data, 40)
    header = json.loads(data[44 : 44 + length])
    at, blocks = 44 + length, []
    while at < len(data):
        (size,) = struct.unpack_from("<Q", data, at)
        blocks.append(zlib.decompress(data[at + 8 : at + 8 + size]))
        at += 8 + size
    counts = header["counts"]
    shaped = lambda flat: flat[: np.prod(counts)].reshape(counts[::-1]).transpose(2, 1, 0)
    hu = shaped(np.frombuffer(blocks[0], "<i2")).astype(float)
    bits = lambda block: np.unpackbits(np.frombuffer(block, np.uint8), bitorder="little")
    masks = {s["name"]: shaped(bits(b)).astype(bool) for s, b in zip(header["structures"], blocks[1:])}
    return header, hu, masks


def transport_grid(header, hu, body, table):
    """Density of the part of the image that holds the patient, and its lower corner in mm."""
    spacing, first = np.array(header["spacing_mm"]), np.array(header["origin_mm"])
    density = np.where(body, np.interp(hu, *np.array(table).T), 0.0)
    inside = np.argwhere(body)
    margin = np.ceil(MARGIN_MM / spacing).astype(int)
    low = np.maximum(inside.min(axis=0) - margin, 0)
    high = np.minimum(inside.max(axis=0) + margin + 1, body.shape)
    cut = tuple(slice(a, b) for a, b in zip(low, high))
    corner = first + (low - 0.5) * spacing
    density = np.ascontiguousarray(np.maximum(density[cut], AIR))
    return VoxelGrid(
        shape=density.shape,
        spacing=tuple(0.1 * spacing),
        origin=tuple(0.1 * corner),
        density=density,
        material=np.zeros(density.shape, np.int32),
    )


class Photons:
    """Draws photons of a plan, in cm and MeV."""

    def __init__(self, plan, machine):
        rows = []
        for beam in plan["beams"]:
            assert not beam.get("couch_deg"), "a beam with a couch angle"
            rows += [(np.radians(beam["gantry_deg"]), *bixel) for bixel in beam["bixels_x_z_mm_weight"] if bixel[2] > 0]
        self.gantry, x, z, weight = np.array(rows).T
        self.place = np.stack([x, z], axis=1)
        fluence = weight * np.interp(np.hypot(x, z), *np.array(machine["primary_fluence_r_mm_value"]).T)
        self.width = plan["dose"]["bixel_mm"]
        # Photons through the isocentre plane, for a fluence of one photon/cm2 and weight.
        self.total = fluence.sum() * (0.1 * self.width) ** 2
        self.share = fluence / fluence.sum()
        self.sigma = machine["penumbra_fwhm_at_iso_mm"] / np.sqrt(8.0 * np.log(2.0))
        self.sad = machine["sad_mm"]
        self.isocentre = np.array(plan["isocentre_mm"])
        spectrum = ali_rogers_mv(BEAM)
        self.edges, self.number = np.asarray(spectrum.edges), np.asarray(spectrum.bin_probabilities)

    def drawn(self, count, rng):
        """A source of `count` tries, and how many photons a try stands for."""
        bixel = rng.choice(self.share.size, size=count, p=self.share)
        plane = self.place[bixel] + self.width * (rng.random((count, 2)) - 0.5) + self.sigma * rng.standard_normal((count, 2))
        # A point source radiates alike into every solid angle: fewer photons per area away from the axis.
        cosine = self.sad / np.sqrt(self.sad**2 + (plane**2).sum(axis=1))
        taken = rng.random(count) < cosine**3
        bixel, plane = bixel[taken], plane[taken]
        sin, cos = np.sin(self.gantry[bixel]), np.cos(self.gantry[bixel])
        turned = lambda x, y, z: np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)
        zero = np.zeros(bixel.size)
        source = self.isocentre + turned(zero, zero - self.sad, zero)
        towards = self.isocentre + turned(plane[:, 0], zero, plane[:, 1]) - source
        towards /= np.linalg.norm(towards, axis=1)[:, None]
        slot = rng.choice(self.number.size, size=bixel.size, p=self.number / self.number.sum())
        energy = self.edges[slot] + (self.edges[slot + 1] - self.edges[slot]) * rng.random(bixel.size)
        one = np.ones(bixel.size)
        return InMemoryPhaseSpaceSource(one.astype(int), energy, *(0.1 * source).T, *towards.T, one), bixel.size / count


def prepare(case, folder, machine_path):
    global STATE
    header, hu, masks = read_case(case)
    plan = json.loads((pathlib.Path(folder) / "plan.json").read_text(encoding="utf-8"))
    machine = json.loads(pathlib.Path(machine_path).read_text(encoding="utf-8"))
    assert plan["leaves"] is None, "a plan with leaves: make it with --fluence-only"
    body = next(s["name"] for s in header["structures"] if s["role"] == "external")
    grid = transport_grid(header, hu, masks[body], machine["hu_to_density"])
    dose = plan["dose"]["grid"]
    spacing, first = np.array(dose["spacing_mm"]), np.array(dose["origin_mm"])
    scored = ScoringGrid.rebin(
        grid, shape=tuple(dose["counts"]), spacing=tuple(0.1 * spacing), origin=tuple(0.1 * (first - 0.5 * spacing))
    )
    engine = WarpEngine(grid=grid, cross_sections=AnalyticCrossSections(grid.max_density_by_material()), device="cpu")
    STATE = (header, masks, plan, machine, scored, engine, Photons(plan, machine))


def chunk(seed):
    """Dose to the voxels for the whole fluence, gray, by one chunk of photons."""
    *_, machine, scored, engine, photons = STATE
    source, taken = photons.drawn(CHUNK, np.random.default_rng(seed))
    count = int(CHUNK * taken) // 5 * 5
    result = engine.run(source, n_histories=count, n_batches=5, seed=seed, scoring_grid=scored)
    return np.asarray(result.dose) * (photons.total * taken * machine["superposition"]["gray_per_mev_g"])


def calibration(machine_path, millions):
    """Mean dose within 15 mm of the axis and 10 mm of the depth of the calibration, gray for a weight of 1, by ten parts."""
    machine = json.loads(pathlib.Path(machine_path).read_text(encoding="utf-8"))
    field = {"gantry_deg": 0.0, "bixels_x_z_mm_weight": [[0.0, 0.0, 1.0]]}
    photons = Photons({"beams": [field], "dose": {"bixel_mm": 100.0}, "isocentre_mm": [0.0, 0.0, 0.0]}, machine)
    grid = VoxelGrid.uniform_water(shape=(60, 60, 60), spacing=(0.5,) * 3, origin=(-15.0, -10.0, -15.0))
    engine = WarpEngine(grid=grid, cross_sections=AnalyticCrossSections(grid.max_density_by_material()), device="cpu")
    parts = []
    for seed in range(10):
        source, taken = photons.drawn(int(float(millions) * 1e5), np.random.default_rng(seed))
        count = int(float(millions) * 1e5 * taken) // 5 * 5
        result = engine.run(source, n_histories=count, n_batches=5, seed=seed)
        dose = np.asarray(result.dose)[27:33, 18:22, 27:33].mean()
        parts.append(dose * photons.total * taken * machine["superposition"]["gray_per_mev_g"])
    print(f"{np.mean(parts):.4f} +- {np.std(parts, ddof=1) / 10**0.5:.4f} Gy in place of 1 Gy")


def reported(folder, counts):
    file = pydicom.dcmread(pathlib.Path(folder) / "rtdose.dcm")
    dose = (file.pixel_array * float(file.DoseGridScaling)).transpose(2, 1, 0)
    assert dose.shape == tuple(counts), "another grid than that of plan.json"
    return dose


def within(header, mask, dose):
    """Voxels of the dose grid whose centre lies in a voxel of the mask."""
    place = [
        np.floor((dose["origin_mm"][a] + np.arange(dose["counts"][a]) * dose["spacing_mm"][a] - header["origin_mm"][a])
                 / header["spacing_mm"][a] + 0.5).astype(int)
        for a in range(3)
    ]
    ok = [(p >= 0) & (p < n) for p, n in zip(place, header["counts"])]
    picked = mask[np.ix_(*[np.clip(p, 0, n - 1) for p, n in zip(place, header["counts"])])]
    return picked & ok[0][:, None, None] & ok[1][None, :, None] & ok[2][None, None, :]


def main(case, folder, machine_path, millions, processes, output=1.0):
    prepare(case, folder, machine_path)
    header, masks, plan, *_ = STATE
    grid = plan["dose"]["grid"]
    seeds = range(2 * max(1, round(float(millions) * 1e6 / CHUNK / 2)))
    halves = np.zeros((2, *grid["counts"]))
    arguments = (case, folder, machine_path)
    with multiprocessing.get_context("spawn").Pool(int(processes), prepare, arguments) as pool:
        for seed, dose in enumerate(pool.imap(chunk, seeds)):
            halves[seed % 2] += dose / (len(seeds) / 2)
            if seed % 10 == 9:
                print(f"{seed + 1} of {len(seeds)}", file=sys.stderr, flush=True)
    mean = halves.mean(axis=0)
    np.save(pathlib.Path(folder) / "monte_carlo.npy", mean.astype(np.float32))
    own = reported(folder, grid["counts"])
    in_plan = {s["name"]: s for s in plan["structures"]}
    role = {s["name"]: s["role"] for s in header["structures"]}
    print(f"{plan['case']['name']}: {len(seeds) * CHUNK / 1e6:.0f} million photons")
    print("D98 / D50 / D2 in Gy, and differences in percent of D50, or of the prescription outside of targets")
    print("| structure | reported, on the grid | by Monte Carlo | photon for photon, % | unit for unit, % | noise of a voxel, % | in plan.json |")
    for name, mask in masks.items():
        inside = within(header, mask, grid)
        if role[name] == "external" or not inside.any():
            continue
        figures = lambda dose: np.percentile(dose[inside], [2, 50, 98])
        # The variance of a half is twice that of the mean, and both move the ends of a histogram in proportion.
        found = 2 * figures(mean) - 0.5 * (figures(halves[0]) + figures(halves[1]))
        by_own = figures(own)
        scale = by_own[1] if role[name] == "target" else plan["prescription"][0]["dose_gy"]
        noise = 0.5 * np.std((halves[0] - halves[1])[inside]) / max(mean[inside].mean(), 1e-9)
        line = lambda values: " / ".join(f"{v:.2f}" for v in values)
        off = lambda by: line(100 * (by_own - found / by) / scale)
        stated = [in_plan[name][figure] for figure in ("d98_gy", "d50_gy", "d2_gy")]
        print(f"| {name} | {line(by_own)} | {line(found)} | {off(1.0)} | {off(float(output))} | {100 * noise:.2f} | {line(stated)} |")
    # Voxels that are in part outside of the patient have another dose in each program.
    body = next(name for name in masks if role[name] == "external")
    hot = (own > 0.1 * own.max()) & within(header, masks[body], grid)
    difference = (own - mean)[hot]
    noise = 0.5 * np.std((halves[0] - halves[1])[hot])
    print(f"rms in the patient where above a tenth of the greatest dose: {np.sqrt(max(0, np.mean(difference**2) - noise**2)):.2f} Gy "
          f"without noise ({noise:.2f} Gy), mean {difference.mean():.2f} Gy")


if __name__ == "__main__":
    calibration(*sys.argv[2:]) if sys.argv[1] == "calibration" else main(*sys.argv[1:])
