"""Replay, what-if and comparison."""

import pytest
import stillpoint_rt as st
from conftest import command


def test_a_simulated_session_replays_identically(session, tmp_path):
    replay = session.replay(record=tmp_path / "again")
    assert replay.identical and replay.differences == 0 and replay.verdict == "identical"
    again = st.Session(tmp_path / "again")
    assert again["filter.state"].array().tobytes() == session["filter.state"].array().tobytes()
    assert session.replay(only="law").identical and session.replay(since="filter").identical


def test_the_recorded_value_gives_the_recorded_bytes_and_another_one_does_not(session, tmp_path):
    same = session.what_if(rerun=["law"])
    assert same.identical and "law" in same.computed
    changed = session.what_if({"law.proportional": "3 1/s"}, record=tmp_path / "changed")
    assert not changed.identical and changed.closed_loop == ["rig"]
    table = changed.table()
    assert len(table) and (table["rms"].dropna() >= 0).all()
    assert set(changed.figures().columns) == {"unit", "recorded", "changed"}

    # The closed loop answers as a fresh run with this value does, to the bit.
    fresh = tmp_path / "fresh"
    command(
        "run", "--clock", "simulated", "--for", "2s", "--record", fresh, "--set", "law.proportional=3 1/s", cwd=tmp_path
    )
    (folder,) = fresh.iterdir()
    computed = st.Session(tmp_path / "changed")
    ran = st.Session(folder)
    assert computed["rig.truth"].array().tobytes() == ran["rig.truth"].array().tobytes()
    found = st.diff(session, ran)
    assert not found.identical and found.first["topic"] in found.changed


def test_a_session_is_identical_to_itself(session):
    found = st.diff(session, session)
    assert found.identical and not found.changed and found.first is None


def test_faults_name_their_place(session):
    with pytest.raises(st.StillpointError, match="law.proportonal"):
        session.what_if({"law.proportonal": "3 1/s"})
    with pytest.raises(st.StillpointError, match="no operator `lawn`"):
        session.replay(only="lawn")
    with pytest.raises(ValueError, match="declared"):
        session.what_if(rerun=["law"], latencies="guessed")
    with pytest.raises(TypeError, match="set="):
        session.what_if("law.proportional=3")
