"""A run that goes on: topics, commands, parameters."""

import subprocess
import sys

import pytest
import stillpoint_rt as st
from conftest import outcome


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The default pipeline, live, until the tests are over."""
    folder = tmp_path_factory.mktemp("live")
    line = [sys.executable, "-m", "stillpoint_rt", "run", "--record", str(folder / "s")]
    process = subprocess.Popen(line, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        while process.poll() is None:
            try:
                joined = st.attach(process.pid)
                break
            except st.StillpointError:
                continue
        else:
            pytest.fail(process.stderr.read())
        yield joined
    finally:
        process.terminate()
        process.communicate(timeout=60)


def test_samples_come_in_order(run):
    assert run.is_going_on and run.pipeline == "head-3dof"
    listener = run.listen("rig.depth")
    samples = [listener.next(timeout=30) for _ in range(3)]
    assert all(sample is not None for sample in samples)
    numbers = [int(sample["sequence"]) for sample in samples]
    assert numbers == list(range(numbers[0], numbers[0] + 3))
    assert len(samples[0]) and samples[0].type.name == "DepthImage"
    states = run.listen("filter.state").take(5, timeout=30)
    assert len(states) == 5 and states["position"].shape == (5, 3)


def test_commands_and_parameters_are_answered(run):
    assert "sent console.disarm" in run.send("console.disarm")
    parameters = {row["parameter"] for row in run.parameters()}
    assert "law.proportional" in parameters
    answer = run.set("law.proportional", "3 1/s")
    assert answer["taken"] and answer["from_activation"] >= 0
    with pytest.raises(st.StillpointError, match="law"):
        run.set("law.proportional", "-3 1/s")


def test_what_is_not_there_is_refused(run):
    with pytest.raises(st.StillpointError, match="no topic `rig.depht`"):
        run.listen("rig.depht")
    with pytest.raises(st.StillpointError, match="no verb"):
        run.send("console.jump")
    with pytest.raises(st.StillpointError, match="no such run"):
        st.attach("nothing")
    assert outcome("ps").returncode == 0
