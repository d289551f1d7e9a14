"""Point kernels in water for the dose by superposition, from a public Monte Carlo program.

    python -m venv /tmp/kernels && /tmp/kernels/bin/pip install pyradmc==0.2.1 warp-lang==1.19.0
    /tmp/kernels/bin/python tools/research/kernels/make_kernels.py \
        stages/planning/plan/data/generic_6mv.json
    BLESS=1 cargo test --workspace --locked -p stillpoint-plan shipped_machine_file

The section `superposition` of the machine file is replaced; the last command brings the file to its usual form.

Photons of the spectrum are forced to interact at the origin of a box of water, and travel along +z. The products of these
first interactions are transported by pyRadMC in two runs: charged particles (the primary kernel), and scattered and
annihilation photons with all that they set free (the scatter kernel). The energy that each run deposits is filed by the
direction (rings about +z) and the distance from the origin (shells).

Energies are in MeV, lengths in cm inside of this file and in mm in the machine file.
"""

import json
import sys

import numpy as np
import pyradmc
from pyradmc import AnalyticCrossSections, InMemoryPhaseSpaceSource, VoxelGrid, WarpEngine, ali_rogers_mv
from pyradmc.data.interface import PhotonProcess
from pyradmc.physics.compton import compton_cos_theta, compton_electron_cos_theta

BEAM = "varian-6mv"
MASS = pyradmc.ELECTRON_MASS_MEV
SEED = 20261128
MSC = "gaussian"
PHOTON, ELECTRON = 1, 2

PRIMARY_EDGES_DEG = [0, 5, 12, 20, 30, 42, 55, 70, 90, 120, 180]
PRIMARY_CONES = [1, 6, 8, 10, 12, 12, 12, 8, 6, 4]
SCATTER_EDGES_DEG = [0, 10, 25, 45, 65, 90, 120, 150, 180]
SCATTER_CONES = [1, 6, 8, 10, 10, 8, 6, 4]
PRIMARY_SHELL_CM, PRIMARY_SHELLS = 0.05, 70
SCATTER_SHELL_CM, SCATTER_SHELLS = 0.5, 60
PRIMARY_DEPTHS_CM, SCATTER_DEPTH_CM = [0.0, 25.0], 7.0
HISTORIES = 1_000_000


class Water:
    """Cross sections of the program, tabulated over the bins of the spectrum."""

    def __init__(self, spectrum):
        source = AnalyticCrossSections(((0, 1.0),))
        self.source = source
        self.edges = np.asarray(spectrum.edges)
        self.energy = 0.5 * (self.edges[:-1] + self.edges[1:])
        of = lambda process: np.array([source.mu_over_rho(float(e), 0, process) for e in self.energy])
        self.compton = of(PhotonProcess.COMPTON)
        self.photo = of(PhotonProcess.PHOTOELECTRIC)
        self.pair = of(PhotonProcess.PAIR)
        self.mu = self.compton + self.photo + self.pair


def klein_nishina(energy, rng):
    """Ratio of the scattered to the incident energy, by rejection from a table of the cross section of each photon."""
    ratio = np.empty_like(energy)
    todo = np.arange(energy.size)
    while todo.size:
        alpha = energy[todo] / MASS
        least = 1.0 / (1.0 + 2.0 * alpha)
        tried = least + (1.0 - least) * rng.random(todo.size)
        cosine = 1.0 - (1.0 / tried - 1.0) / alpha
        # The differential cross section in the ratio, which is greatest at one of the ends.
        density = tried + 1.0 / tried - (1.0 - cosine**2)
        accepted = rng.random(todo.size) * (least + 1.0 / least) < density
        ratio[todo[accepted]] = tried[accepted]
        todo = todo[~accepted]
    return ratio


def directions(cosine, azimuth):
    sine = np.sqrt(np.maximum(0.0, 1.0 - cosine**2))
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=1)


def first_interactions(water, number, depth_cm, count, rng):
    """Charged particles and photons of `count` first interactions below `depth_cm` of water; energies and directions."""
    weight = number * water.mu * np.exp(-water.mu * depth_cm)
    place = rng.choice(weight.size, size=count, p=weight / weight.sum())
    energy = water.edges[place] + (water.edges[place + 1] - water.edges[place]) * rng.random(count)
    mu = water.mu[place]
    drawn = rng.random(count) * mu
    is_compton = drawn < water.compton[place]
    is_photo = ~is_compton & (drawn < water.compton[place] + water.photo[place])
    is_pair = ~is_compton & ~is_photo & (energy > 2.0 * MASS)
    is_compton |= ~is_photo & ~is_pair

    e = energy[is_compton]
    ratio = klein_nishina(e, rng)
    alpha = e / MASS
    cosine = np.clip(1.0 - (1.0 / ratio - 1.0) / alpha, -1.0, 1.0)
    # cot(angle of the electron) = (1 + alpha) tan(angle of the photon / 2).
    tangent = np.sqrt((1.0 - cosine) / np.maximum(1.0 + cosine, 1e-300))
    electron_cosine = (1.0 + alpha) * tangent / np.sqrt(1.0 + ((1.0 + alpha) * tangent) ** 2)
    azimuth = 2.0 * np.pi * rng.random(e.size)
    check = np.array([compton_cos_theta(float(a), float(b)) for a, b in zip(e[:50], ratio[:50])])
    assert np.allclose(check, cosine[:50], atol=1e-9)
    check = np.array([compton_electron_cos_theta(float(a), float(b)) for a, b in zip(e[:50], ratio[:50])])
    assert np.allclose(check, electron_cosine[:50], atol=1e-9)

    forward = lambda n: np.tile([0.0, 0.0, 1.0], (n, 1))
    kinetic = energy[is_pair] - 2.0 * MASS
    share = rng.random(kinetic.size)
    # A positron is followed as an electron; its annihilation photons belong to the scatter.
    charged = (
        np.concatenate([e * (1.0 - ratio), energy[is_photo], kinetic * share, kinetic * (1.0 - share)]),
        np.concatenate(
            [
                directions(electron_cosine, azimuth + np.pi),
                forward(int(is_photo.sum())),
                forward(kinetic.size),
                forward(kinetic.size),
            ]
        ),
    )
    one = directions(2.0 * rng.random(kinetic.size) - 1.0, 2.0 * np.pi * rng.random(kinetic.size))
    photons = (
        np.concatenate([e * ratio, np.full(2 * kinetic.size, MASS)]),
        np.concatenate([directions(cosine, azimuth), one, -one]),
    )
    return charged, photons, float(energy.sum())


def transported(kind, energies, towards, half_cells, cell_cm, seed):
    """Energy (MeV, all particles together) by cell of a box of water, and the coordinates of the cells.

    `half_cells` are the cells on both sides along x, and those before and behind the origin along z.
    """
    side, before, behind = half_cells
    shape = (2 * side, 2 * side, before + behind)
    origin = (-side * cell_cm, -side * cell_cm, -before * cell_cm)
    # The water around the box is left out: what leaves it and is scattered back is what the box is made large for.
    grid = VoxelGrid.uniform_water(shape=shape, spacing=(cell_cm,) * 3, origin=origin)
    # The origin lies in a cell's corner: particles start in each of the cells around it by their direction.
    start = 1e-5 * towards
    zeros = np.zeros_like(energies)
    order = np.random.default_rng(seed).permutation(energies.size)
    source = InMemoryPhaseSpaceSource(
        np.full(energies.size, kind), energies[order], *(start[order].T + zeros), *towards[order].T, zeros + 1.0
    )
    engine = WarpEngine(grid=grid, cross_sections=AnalyticCrossSections(((0, 1.0),)), device="cpu")
    count = energies.size - energies.size % 5
    result = engine.run(source, n_histories=count, n_batches=5, seed=seed, msc_model=MSC)
    mass = cell_cm**3
    # Per emitted history, of particles sampled with replacement from the population.
    energy = np.asarray(result.dose) * mass * energies.size
    print(
        f"{energies.size} of kind {kind}: emitted {energies.sum():.0f} MeV, in the box {energy.sum():.0f} MeV",
        file=sys.stderr,
    )
    centres = [origin[a] + (np.arange(shape[a]) + 0.5) * cell_cm for a in range(3)]
    return energy, centres


def filed(energy, centres, cell_cm, edges_deg, shell_cm, shells, parts=4):
    """Energy by ring and shell; each cell is cut into `parts` along each axis."""
    table = np.zeros((len(edges_deg) - 1, shells + 1))
    cosines = np.cos(np.radians(edges_deg))[::-1]
    offsets = (np.arange(parts) + 0.5) / parts * cell_cm - 0.5 * cell_cm
    part = energy / parts**3
    for dx in offsets:
        for dy in offsets:
            for dz in offsets:
                x = (centres[0] + dx)[:, None, None]
                y = (centres[1] + dy)[None, :, None]
                z = (centres[2] + dz)[None, None, :]
                r = np.sqrt(x * x + y * y + z * z)
                ring = len(edges_deg) - 2 - np.clip(np.searchsorted(cosines, z / r) - 1, 0, len(edges_deg) - 2)
                shell = np.minimum((r / shell_cm).astype(int), shells)
                flat = np.bincount((ring * (shells + 1) + shell).ravel(), weights=part.ravel(), minlength=table.size)
                table += flat.reshape(table.shape)
    return table


def kernel(kind, particles, edges_deg, shell_cm, shells, near, far, seed):
    """Energy by ring and shell: the inner shells of a fine box, the outer of a coarse one. Each of `near` and `far` is a
    cell's width and the cells of the box; `near` ends with the number of shells that are taken from it."""
    energies, towards = particles
    (near_cm, near_cells, inner), (far_cm, far_cells) = near, far
    fine = filed(*transported(kind, energies, towards, near_cells, near_cm, seed), near_cm, edges_deg, shell_cm, shells)
    coarse = filed(*transported(kind, energies, towards, far_cells, far_cm, seed + 1), far_cm, edges_deg, shell_cm, shells)
    table = np.concatenate([fine[:, :inner], coarse[:, inner:]], axis=1)
    return table[:, :shells]


def charged_share(water, rng):
    """Part of the energy of a photon's first interaction that charged particles carry, by bin."""
    recoil = np.empty_like(water.energy)
    for place, energy in enumerate(water.energy):
        e = np.full(20_000, energy)
        recoil[place] = energy * (1.0 - klein_nishina(e, rng).mean())
    pair = np.maximum(0.0, water.energy - 2.0 * MASS)
    return (water.compton * recoil + water.photo * water.energy + water.pair * pair) / (water.mu * water.energy)


def digits(values, count):
    return [float(f"{v:.{count}g}") for v in values]


def main(path):
    spectrum = ali_rogers_mv(BEAM)
    water = Water(spectrum)
    number = np.asarray(spectrum.bin_probabilities)
    rng = np.random.default_rng(SEED)
    primary = []
    for depth_cm in PRIMARY_DEPTHS_CM:
        charged, _, _ = first_interactions(water, number, depth_cm, HISTORIES, rng)
        table = kernel(
            ELECTRON, charged, PRIMARY_EDGES_DEG, PRIMARY_SHELL_CM, PRIMARY_SHELLS,
            near=(0.02, (40, 40, 40), 14), far=(0.1, (37, 20, 40)), seed=SEED,
        )
        # Bremsstrahlung leaves the last shell: what stays is taken as all.
        print(f"primary at {depth_cm} cm: {table.sum() / charged[0].sum():.4f} within", file=sys.stderr)
        primary.append(table / table.sum())
    _, photons, _ = first_interactions(water, number, SCATTER_DEPTH_CM, HISTORIES, rng)
    scatter = kernel(
        PHOTON, photons, SCATTER_EDGES_DEG, SCATTER_SHELL_CM, SCATTER_SHELLS,
        near=(0.1, (40, 40, 40), 6), far=(0.5, (70, 62, 75)), seed=SEED + 10,
    ) / photons[0].sum()
    print(f"scatter: {scatter.sum():.4f} within", file=sys.stderr)
    with open(path) as file:
        machine = json.load(file)
    machine["superposition"] = {
        "provenance": f"Kernels: tools/research/kernels/make_kernels.py with pyRadMC {pyradmc.__version__} (Apache-2.0), "
        f"{water.source.provenance}; multiple scattering {MSC}, ECUT {pyradmc.ECUT_MEV} MeV, PCUT {pyradmc.PCUT_MEV} MeV, "
        f"seed {SEED}, {HISTORIES} first interactions a kernel. Spectrum: {BEAM} of Ali and Rogers, "
        "Phys. Med. Biol. 57 (2012) 31.",
        # Set so that the test of the reference field passes: tests/dose/superposition.
        "gray_per_mev_g": machine.get("superposition", {}).get("gray_per_mev_g", 1.0),
        "energy_mev": digits(water.energy, 5),
        "photons": digits(number, 6),
        "attenuation_per_mm": digits(0.1 * water.mu, 6),
        "charged_share": digits(charged_share(water, rng), 5),
        "primary": {
            "edges_deg": PRIMARY_EDGES_DEG,
            "cones": PRIMARY_CONES,
            "shell_mm": 10.0 * PRIMARY_SHELL_CM,
            "depths_mm": [10.0 * d for d in PRIMARY_DEPTHS_CM],
            "energy": [[digits(ring, 4) for ring in table] for table in primary],
        },
        "scatter": {
            "edges_deg": SCATTER_EDGES_DEG,
            "cones": SCATTER_CONES,
            "shell_mm": 10.0 * SCATTER_SHELL_CM,
            "depths_mm": [10.0 * SCATTER_DEPTH_CM],
            "energy": [[digits(ring, 4) for ring in scatter]],
        },
    }
    with open(path, "w") as file:
        json.dump(machine, file)


if __name__ == "__main__":
    main(sys.argv[1])
