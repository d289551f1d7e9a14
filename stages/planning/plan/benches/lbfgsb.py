"""L-BFGS-B of scipy on the problems of `--bench fluence`: CPU seconds until an excess over the optimum is reached.

    STILLPOINT_DATA=... OMP_NUM_THREADS=1 python stages/planning/plan/benches/lbfgsb.py

It starts with equal weights at the dose of the goals and keeps 20 corrections.
"""

import json
import os
import time

import numpy
from scipy.optimize import minimize
from scipy.sparse import csc_matrix

EXCESSES = (1e-3, 1e-4, 1e-6)


class Reached(Exception):
    pass


def seconds(path):
    problem = numpy.load(path + ".npz")
    with open(path + ".json", encoding="utf-8") as about:
        optimum = json.load(about)["optimum_lbfgsb"]
    parts = (problem["data"], problem["row"], problem["colptr"])
    by_rows = csc_matrix(parts, shape=tuple(problem["shape"])).tocsr().astype(float)
    by_columns = by_rows.T.tocsr()
    high, low, over, under = (problem[name].astype(float) for name in ("hi", "lo", "wo", "wu"))
    ones = by_rows @ numpy.ones(by_rows.shape[1])
    wanted = under > 0
    begin = numpy.full(by_rows.shape[1], (low[wanted] @ ones[wanted]) / (ones[wanted] @ ones[wanted]))
    found, evaluations, began = {}, 0, time.process_time()

    def objective(x):
        nonlocal evaluations
        evaluations += 1
        dose = by_rows @ x
        above, below = numpy.maximum(dose - high, 0), numpy.maximum(low - dose, 0)
        value = float(over @ above**2 + under @ below**2)
        gradient = by_columns @ (2 * over * above - 2 * under * below)
        for excess in EXCESSES:
            if excess not in found and value <= optimum * (1 + excess):
                found[excess] = (time.process_time() - began, evaluations)
        if EXCESSES[-1] in found:
            raise Reached
        return value, gradient

    limits = {"maxiter": 20000, "maxfun": 40000, "maxcor": 20, "ftol": 0, "gtol": 0}
    try:
        minimize(objective, begin, jac=True, method="L-BFGS-B", bounds=[(0, None)] * len(begin), options=limits)
    except Reached:
        pass
    return found


folder = os.path.join(os.environ["STILLPOINT_DATA"], "planning")
for name in ("fmo5_pelvis_000", "fmo9_tg119"):
    runs = [seconds(os.path.join(folder, name)) for _ in range(3)]
    for excess in EXCESSES:
        median = sorted(run[excess] for run in runs)[1]
        print(f"{name}, excess {excess:g}: {median[0]:.3f} CPU s, {median[1]} evaluations")
