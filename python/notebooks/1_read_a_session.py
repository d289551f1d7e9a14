# %% [markdown]
# # Read a session
# Two seconds of the default pipeline in simulated time, and where the head was.

# %%
import subprocess
import sys

import stillpoint_rt as st

line = [sys.executable, "-m", "stillpoint_rt", "run", "--clock", "simulated", "--for", "2s", "--record", "sessions"]
subprocess.run(line, check=True)

# %%
session = st.Session("sessions/head-3dof-0001")
print(session.topics())

# %% [markdown]
# The estimate against the truth that the rig knows, in millimetres.

# %%
estimate = session["filter.state"].frame()
truth = session["rig.truth"].frame()
axes = estimate["position.z"].mul(1e3).rename("filter").plot(legend=True)
truth["position.z"].mul(1e3).rename("truth").plot(ax=axes, legend=True)
axes.set_ylabel("height, mm")
axes.figure.savefig("height.png")

# %% [markdown]
# When was the beam allowed, and why was it not?

# %%
gate = session["gate.state"].frame()
print(gate["beam"].value_counts())
print(gate["reasons"].value_counts().head())
