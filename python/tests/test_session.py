"""Topics as arrays and frames."""

import csv
import os
import subprocess
import sys

import numpy as np
import pytest
import stillpoint_rt as st
from conftest import command


def test_topics_have_their_type_role_and_count(session):
    topics = session.topics()
    assert set(topics.index) == set(session)
    assert topics.loc["filter.state", "type"] == "Track"
    assert topics.loc["rig.journal", "role"] == "journal"
    assert session["filter.state"].frame_id == "couch"
    assert all(len(topic.array()) == topic.samples for topic in session.values() if topic.samples)
    assert not session.gaps and "pipeline.yaml" in session.attachments
    assert session.attachment("pipeline.yaml").startswith(b"#") or b"operators:" in session.attachment("pipeline.yaml")


def test_every_number_is_the_one_of_the_csv_export(session, tmp_path):
    """The command's own export reads the same bytes by another path, so both must agree on every number."""
    command("export", session.path, "filter.state", "gate.state", "--out", tmp_path / "csv")
    for name in ("filter.state", "gate.state"):
        with open(tmp_path / "csv" / f"{name}.csv") as file:
            lines = list(csv.DictReader(file))
        frame = session[name].frame(words=False)
        assert len(frame) == len(lines) > 10
        shared = 0
        for column in lines[0]:
            ours = column.split(" [")[0]
            if ours.endswith("_ns"):
                ours = ours.removesuffix("_ns")
            if ours not in frame:
                continue
            shared += 1
            theirs = np.array([float(line[column]) for line in lines])
            np.testing.assert_array_equal(frame[ours].to_numpy(float), theirs, err_msg=column)
        assert shared >= 8, list(lines[0])


def test_a_fixed_sample_is_a_row_and_its_arrays_are_columns(session):
    topic = session["filter.state"]
    array = topic.array()
    assert array.dtype["position"].shape == (3,)
    frame = topic.frame()
    assert frame.attrs["units"]["position.z"] == "m" and frame.index.name == "time"
    np.testing.assert_array_equal(frame["position.z"], array["position"][:, 2])
    assert frame.index[0] >= 0 and frame.index[-1] <= 2.1


def test_codes_and_bits_are_words(session):
    frame = session["gate.state"].frame()
    assert set(frame["beam"].cat.categories) <= {"on", "off"}
    reasons = session["gate.state"].type.field("reasons")
    assert reasons.words(0) == "none"
    first = next(iter(reasons.bits))
    assert reasons.words(first) == reasons.bits[first]
    assert "unknown to this build" in reasons.words(1 << 31)
    assert session["gate.state"].frame(words=False)["beam"].dtype.kind == "u"


def test_elements_of_slices_are_found_by_their_starts(session):
    topic = next(t for t in session.values() if t.type.is_slice and t.type.name == "Journal")
    elements, starts = topic.elements()
    assert len(starts) == len(topic) + 1 and starts[-1] == len(elements)
    np.testing.assert_array_equal(np.diff(starts), topic.array()["count"])
    frame = topic.frame()
    assert len(frame) == len(elements)


def test_diagnostics_have_a_column_for_each_metric(session):
    topic = next(t for t in session.values() if t.type.name == "Diagnostics" and t.samples)
    frame = topic.frame()
    assert len(frame) == topic.samples
    metrics = [c for c in frame if c not in ("stamp", "origin", "sequence", "incarnation")]
    assert metrics and frame[metrics].notna().any().all()


def test_a_span_of_time_has_the_rows_of_this_span(session):
    topic = session["filter.state"]
    whole = topic.array()
    part = topic.array(after=0.5, until=1.0)
    time = topic.time(whole)
    assert part.tobytes() == whole[(time >= 0.5) & (time < 1.0)].tobytes()
    assert 0 < len(part) < len(whole)
    assert len(topic.array(after=5.0)) == 0


def test_what_is_not_there_is_an_error_with_what_is_there(session, tmp_path):
    with pytest.raises(KeyError, match="filter.state"):
        session["filter.stat"]
    with pytest.raises(KeyError, match="pipeline.yaml"):
        session.attachment("nothing")
    with pytest.raises(st.StillpointError, match="nowhere"):
        st.Session(tmp_path / "nowhere")
    with pytest.raises(KeyError, match="no field"):
        session["filter.state"].type.field("nothing")


def damaged(whole: bytes, trial: int, random: np.random.Generator) -> bytes:
    """A file that was cut, with a flipped bit, with bytes of nothing, or with a part of it twice: in turn."""
    at = int(random.integers(8, len(whole)))
    length = int(random.integers(1, 400))
    match trial % 4:
        case 0:
            return whole[:at]
        case 1:
            return whole[:at] + bytes([whole[at] ^ 1 << int(random.integers(8))]) + whole[at + 1 :]
        case 2:
            return whole[:at] + random.bytes(length) + whole[at + length :]
        case _:
            return whole[:at] + whole[max(8, at - length) : at] + whole[at:]


def test_damaged_files_are_errors_or_sessions_with_gaps(recorded, tmp_path):
    """A session opens, with gaps where it lacks something, or is refused; the process goes on.

    100 files, and as many as `STILLPOINT_BROKEN` says where it is set.
    """
    (part,) = recorded.glob("*.mcap")
    whole = part.read_bytes()
    random = np.random.default_rng(1)
    trials = int(os.environ.get("STILLPOINT_BROKEN", "100"))
    opened = refused = 0
    for trial in range(trials):
        file = tmp_path / "broken.mcap"
        file.write_bytes(damaged(whole, trial, random))
        try:
            found = st.Session(file)
            for topic in found.values():
                topic.array()
            found["filter.state"].frame()
            opened += 1
        except (st.StillpointError, KeyError):
            refused += 1
    assert opened + refused == trials and opened > trials // 5


def test_reading_needs_numpy_alone(recorded):
    code = (
        "import sys; sys.modules['pandas'] = None; sys.modules['scipy'] = None\n"
        "import stillpoint_rt as st\n"
        f"s = st.Session({str(recorded)!r})\n"
        "print(len(s['filter.state'].array()))\n"
        "try:\n    s['filter.state'].frame()\nexcept ImportError as e:\n    print(e)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    count, reason = done.stdout.splitlines()
    assert int(count) > 0 and "pip install" in reason


def test_types_have_units_and_meanings():
    types = st.sample_types()
    assert types["Track"].field("position").unit == "m"
    assert types["PointCloud"].is_slice
    assert all(field.about for kind in types.values() for field in kind.fields)
