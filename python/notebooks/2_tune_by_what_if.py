# %% [markdown]
# # Tune a law by what-if
# The same recorded patient under other gains: a simulated patient reacts, so the loop is closed.

# %%
import subprocess
import sys

import stillpoint_rt as st

line = [sys.executable, "-m", "stillpoint_rt", "run", "--clock", "simulated", "--for", "4s", "--record", "sessions"]
subprocess.run(line, check=True)
session = st.Session("sessions/head-3dof-0001")

# %%
errors = {}
for gain in (1.5, 3.5):
    answer = session.what_if({"law.proportional": f"{gain} 1/s"}, record=f"gain-{gain}")
    assert answer.closed_loop == ["rig"]
    state = st.Session(f"gain-{gain}")["rig.truth"].frame(after=2.5)
    errors[gain] = state["position.z"].diff().std() * 1e3
print(errors)

# %% [markdown]
# The recorded gain gives the recorded bytes.

# %%
assert session.what_if({"law.proportional": "2.37 1/s"}, rerun=["law"]).identical
