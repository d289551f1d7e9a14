"""Sessions, plans and operators of stillpoint.

    import stillpoint_rt as st

    session = st.Session("sessions/head-3dof-0001")
    session["head.pose"].frame()["position.z"].plot()
    session.what_if(set={"law.proportional": "3 1/s"}).table()

Numbers are those of the samples: SI units, frames as the session states them. The package is not a part of the project
`stillpoint` of the public index.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_HOMES = {
    "Beams": ".planning",
    "Case": ".planning",
    "Comparison": ".compare",
    "Field": ".samples",
    "Listener": ".live",
    "Objectives": ".planning",
    "Plan": ".planning",
    "Replay": ".compare",
    "Run": ".live",
    "Sample": ".samples",
    "SampleType": ".samples",
    "Session": ".session",
    "Setup": ".planning",
    "StillpointError": "._native",
    "Topic": ".session",
    "WhatIf": ".compare",
    "attach": ".live",
    "diff": ".compare",
    "sample_types": ".samples",
}


def __getattr__(name: str) -> Any:
    """Imports a name when it is first used, so that the processes of a run begin without numpy."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name], __name__), name)
