"""Sessions, plans and operators of stillpoint.

    import stillpoint_rt as st

    session = st.Session("sessions/head-3dof-0001")
    session["head.pose"].frame()["position.z"].plot()
    session.what_if(set={"law.proportional": "3 1/s"}).table()

Numbers are those of the samples: SI units, frames as the session states them. The package is not a part of the project
`stillpoint` of the public index.
"""

from ._native import StillpointError
from .compare import Comparison, Replay, WhatIf, diff
from .live import Listener, Run, attach
from .planning import Beams, Case, Objectives, Plan, Setup
from .samples import Field, Sample, SampleType, sample_types
from .session import Session, Topic

__all__ = [
    "Beams",
    "Case",
    "Comparison",
    "Field",
    "Listener",
    "Objectives",
    "Plan",
    "Replay",
    "Run",
    "Sample",
    "SampleType",
    "Session",
    "Setup",
    "StillpointError",
    "Topic",
    "WhatIf",
    "attach",
    "diff",
    "sample_types",
]
