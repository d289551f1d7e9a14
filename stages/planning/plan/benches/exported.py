"""L-BFGS-B of scipy on a folder that `stillpoint plan export` wrote; its weights go to `weights.npy` in that folder.

    OMP_NUM_THREADS=1 python stages/planning/plan/benches/exported.py matrix 1000

It knows the shapes of the shipped objectives, starts with equal weights at the dose of the goals, and keeps 20 corrections.
"""

import csv
import json
import os
import sys
import time

import numpy
from scipy.optimize import minimize
from scipy.sparse import csr_matrix

folder, most = sys.argv[1], int(sys.argv[2])


def load(name):
    return numpy.load(os.path.join(folder, f"dose-{name}.npy"))


with open(os.path.join(folder, "problem.json"), encoding="utf-8") as file:
    problem = json.load(file)
with open(os.path.join(folder, "bixels.csv"), encoding="utf-8", newline="") as file:
    bixels = list(csv.DictReader(file))
by_rows = csr_matrix((load("data"), load("indices"), load("starts")), tuple(problem["shape"])).astype(float)
by_columns = by_rows.T.tocsr()
points, columns = by_rows.shape

# Terms of single points: row, goal, weight and side (1 above the goal, -1 below); means: share of each point, goal, weight.
terms, means = [], []
for structure in problem["structures"]:
    rows, volumes = numpy.array(structure["voxels"]), numpy.array(structure["volumes"])
    distance = numpy.array(structure["to_target_mm"])
    for objective in structure["objectives"]:
        ((shape, numbers),) = objective.items()
        weight = numbers["weight"]
        if shape in ("overdose", "underdose"):
            goal = numpy.full(len(rows), numbers["dose_gy"])
            side = 1.0 if shape == "overdose" else -1.0
            terms.append((rows, goal, weight * volumes / volumes.sum(), side))
        elif shape == "fall_off":
            part = numpy.minimum(distance / numbers["over_mm"], 1)
            goal = numbers["near_gy"] + (numbers["far_gy"] - numbers["near_gy"]) * part
            within = volumes[distance <= numbers["over_mm"]].sum()
            terms.append((rows, goal, weight * volumes / within, 1.0))
        elif shape == "mean_dose":
            means.append((rows, volumes / volumes.sum(), numbers["dose_gy"], weight))
        else:
            sys.exit(f"the shape {shape} is not known here")

# Neighbours share an edge, and peaks are above so many means of their beam.
modulation, width = problem["modulation"], problem["bixel_mm"]
place = {(b["beam"], float(b["x_mm"]), float(b["z_mm"])): i for i, b in enumerate(bixels)}
pairs = [
    (i, place[key])
    for (beam, x, z), i in place.items()
    for key in ((beam, x + width, z), (beam, x, z + width))
    if key in place
]
first, second = (numpy.array(side) for side in zip(*pairs))
beams = [numpy.array([i for i, b in enumerate(bixels) if b["beam"] == beam]) for beam in {b["beam"] for b in bixels}]


def objective(x):
    dose = by_rows @ x
    value, slope = 0.0, numpy.zeros(points)
    for rows, goal, weight, side in terms:
        off = numpy.maximum(side * (dose[rows] - goal), 0)
        value += weight @ off**2
        slope[rows] += 2 * side * weight * off
    for rows, share, goal, weight in means:
        off = max(share @ dose[rows] - goal, 0)
        value += weight * off**2
        slope[rows] += 2 * weight * off * share
    gradient = by_columns @ slope
    difference = x[first] - x[second]
    scale = modulation["neighbours"] / columns
    value += scale * difference @ difference
    numpy.add.at(gradient, first, 2 * scale * difference)
    numpy.add.at(gradient, second, -2 * scale * difference)
    for beam in beams:
        off = numpy.maximum(x[beam] - modulation["times_mean"] * x[beam].mean(), 0)
        scale = modulation["peaks"] / columns
        value += scale * off @ off
        gradient[beam] += 2 * scale * (off - modulation["times_mean"] * off.sum() / len(beam))
    return value, gradient


ones = by_rows @ numpy.ones(columns)
wanted = [(ones[rows], goal) for rows, goal, _, side in terms if side < 0]
begin = sum(o @ g for o, g in wanted) / sum(o @ o for o, _ in wanted)
began = time.process_time()
options = {"maxiter": most, "maxfun": 2 * most, "maxcor": 20, "ftol": 1e-12, "gtol": 0}
found = minimize(
    objective, numpy.full(columns, begin), jac=True, method="L-BFGS-B", bounds=[(0, None)] * columns, options=options
)
numpy.save(os.path.join(folder, "weights.npy"), found.x)
print(f"{found.fun:.4f} after {found.nfev} evaluations, {time.process_time() - began:.1f} CPU s")
