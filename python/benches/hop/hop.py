"""How long a cloud of 1.2 MB takes from its source through an operator that doubles it to a consumer: in Rust and in Python.

`double.rs` is the operator in Rust: the program of a crate of `stillpoint new operator`. In a folder with this file,
`hop.yaml` and the program as `double`:

    python -m stillpoint_rt run hop.yaml --for 30s --record sessions
    python hop.py sessions/hop-0001

The first and the last two seconds do not count.
"""

import sys

import numpy as np
from stillpoint_rt.operator import Input, Operator, Output


class Double(Operator):
    """Doubles a cloud into memory that it keeps."""

    cloud = Input("PointCloud", queue=4)
    twice = Output("PointCloud", frame_of="cloud", capacity=100_000)

    def start(self):
        self.points = None

    def step(self, activation):
        cloud = activation["cloud"]
        if self.points is None:
            self.points = np.empty_like(cloud.elements)
        np.multiply(cloud["xyz"], 2, out=self.points["xyz"])
        activation.send("twice", self.points, width=cloud["width"], height=cloud["height"])


class Arrival(Operator):
    """Sends a sample at each cloud, with the time of the activation and the origin of the cloud."""

    twice = Input("PointCloud", queue=4)
    origin = Output("Diagnostics", capacity=1)

    def step(self, activation):
        activation.send("origin")


def main(path: str) -> None:
    import stillpoint_rt as st

    session = st.Session(path, trust=True)
    medians = {}
    for side in ("rust", "python"):
        sent = session[f"from_{side}.origin"].array(after=2)
        hop = (sent["stamp"].astype(np.int64) - sent["origin"].astype(np.int64))[:-100] * 1e-3
        medians[side] = np.median(hop)
        print(f"{side}: {len(hop)} clouds, p50 {medians[side]:.0f} us, p90 {np.percentile(hop, 90):.0f} us, p99 {np.percentile(hop, 99):.0f} us")
    print(f"ratio of the medians {medians['python'] / medians['rust']:.2f}")


if __name__ == "__main__":
    main(sys.argv[1])
