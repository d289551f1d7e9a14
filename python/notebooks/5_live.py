# %% [markdown]
# # A live plot
# A run of the default pipeline, the pose of the simulated head as it comes, and a command.

# %%
import subprocess
import sys
import time

import matplotlib.pyplot as plt
import stillpoint_rt as st

process = subprocess.Popen([sys.executable, "-m", "stillpoint_rt", "run", "--for", "90s", "--record", "sessions"])
while True:
    try:
        run = st.attach(process.pid)
        break
    except st.StillpointError:
        assert process.poll() is None, "the run has not begun"
        time.sleep(0.1)

# %%
truth = run.listen("rig.truth")
figure, axes = plt.subplots()
(line,) = axes.plot([], [])
heights = []
for sample in truth:
    heights.append(1e3 * sample["position"][2])
    if len(heights) % 10 == 0:  # In a notebook: display(figure) here.
        line.set_data(range(len(heights)), heights)
        axes.relim()
        axes.autoscale_view()
    if len(heights) == 30:
        break
figure.savefig("live.png")

# %%
print(run.send("console.disarm"))
process.terminate()
process.wait()
assert not run.is_going_on
