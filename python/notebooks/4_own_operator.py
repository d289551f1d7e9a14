# %% [markdown]
# # An operator of your own
# A class in a file, a pipeline that uses it, a simulated run, and a replay to the bit.

# %%
import subprocess
import sys
from pathlib import Path

import stillpoint_rt as st

Path("ops").mkdir()
Path("ops/drift.py").write_text('''
from stillpoint_rt.operator import Input, Operator, Output, Param


class Drift(Operator):
    """A head that drifts up."""

    timer = "required"
    track = Output("Track", framed=True)
    speed = Param(0.001, unit="m/s", min=0, max=1, about="Speed of the drift.")

    def step(self, activation):
        height = self.speed * activation.index * self.every * 1e-9
        noise = 1e-5 * activation.random().standard_normal(3)
        activation.send("track", position=noise + [0, 0, height], orientation=[1, 0, 0, 0])


class Mean(Operator):
    """The mean of the last positions."""

    track = Input("Track", queue=4)
    mean = Output("Track", frame_of="track")
    count = Param(10, min=1, max=1000, about="Positions that count.")

    def start(self):
        self.last = []

    def step(self, activation):
        track = activation.fresh("track")
        self.last = [*self.last, track["position"].copy()][-self.count :]
        activation.send("mean", track, position=sum(self.last) / len(self.last))
''')
Path("drift.yaml").write_text("""
stillpoint: 1
name: drift
frames: { camera: { parent: couch, at: [0 mm, 0 mm, 500 mm] } }
operators:
  drift: { use: "ops/drift.py:Drift", every: 20 ms, frame: couch }
  mean: { use: "ops/drift.py:Mean", inputs: { track: { from: drift.track, queue: 4 } } }
record: { topics: all }
""")


def stillpoint(*arguments):
    subprocess.run([sys.executable, "-m", "stillpoint_rt", *arguments], check=True)


stillpoint("check", "drift.yaml")
stillpoint("run", "drift.yaml", "--clock", "simulated", "--for", "4s", "--record", "sessions")

# %%
session = st.Session("sessions/drift-0001", trust=True)
assert session.replay().identical
noise = [session[topic].frame()["position.x"].std() for topic in ("drift.track", "mean.mean")]
print(noise)
assert noise[1] < noise[0] / 2

# %% [markdown]
# Fewer positions, on the recorded track: what would have been.

# %%
answer = session.what_if({"mean.count": 2})
print(answer.table()[["rms", "worst"]])
