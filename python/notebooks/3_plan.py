# %% [markdown]
# # Plan with an objective of your own
# A quadratic objective over the dose matrix alone, next to the shipped plan on the same beams.

# %%
import numpy as np
import stillpoint_rt as st
from scipy.optimize import minimize

case = st.Case.phantom(0)
setup = case.setup(grid_mm=12, bixel_mm=20)
beams = setup.beams([0, 72, 144, 216, 288])
dose = beams.dose
(target,) = case.prescription
goal = case.prescription[target]
inside, volumes = setup.rows_of(target)
around, weight = setup.rows_of("Rectum")

# %%
target_dose, organ_dose = dose[inside], dose[around]


def objective(weights):
    off = target_dose @ weights - goal
    organ = organ_dose @ weights
    cost = (volumes @ off**2) / volumes.sum() + 0.02 * (weight @ organ**2) / weight.sum()
    slope = 2 * (target_dose.T @ (volumes * off)) / volumes.sum()
    slope += 0.04 * (organ_dose.T @ (weight * organ)) / weight.sum()
    return cost, slope


start = np.full(len(beams), 1.0)
bounds = [(0, None)] * len(beams)
own = minimize(objective, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 100})

# %%
plans = {"own": beams.plan(own.x), "shipped": beams.solve()}
for name, plan in plans.items():
    plan.grid_mm = 6.0
    print(name, plan.cost)
    print(plan.figures().loc[[target, "Rectum"], ["d95_gy", "d50_gy", "mean_gy"]])
assert plans["shipped"].cost < plans["own"].cost
