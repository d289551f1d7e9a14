"""Operators in Python: checked, simulated, live, replayed."""

import json
import textwrap

import numpy as np
import pytest
import stillpoint_rt as st
from conftest import command, outcome

WAVES = '''
import numpy as np
from stillpoint_rt.operator import Operator, Output, Param

class Waves(Operator):
    """A head that moves up and down, with noise."""

    timer = "required"
    track = Output("Track", framed=True)
    size = Param(0.01, unit="m", min=0, max=1, about="Amplitude.")

    def step(self, activation):
        height = self.size * np.sin(activation.index / 10)
        noise = 1e-4 * activation.random().standard_normal(3)
        activation.send("track", position=noise + [0, 0, height], orientation=[1, 0, 0, 0])
'''

SMOOTH = '''
import helper
from stillpoint_rt.operator import Input, Operator, Output, Param

class Smooth(Operator):
    """Smooths the position of a track."""

    track = Input("Track", queue=4)
    smooth = Output("Track", frame_of="track")
    share = Param(0.5, min=0, max=1, about="Share of the new position.")

    def start(self):
        self.position = None

    def step(self, activation):
        track = activation.fresh("track")
        if track is None:
            return
        self.position = helper.between(self.position, track["position"], self.share)
        activation.send("smooth", track, position=self.position)
'''

HELPER = '''
def between(old, new, share):
    return new.copy() if old is None else old + share * (new - old)
'''

PIPELINE = '''
stillpoint: 1
name: waves
seed: 7
frames: { camera: { parent: couch, at: [0 mm, 0 mm, 500 mm] } }
operators:
  waves: { use: "ops/waves.py:Waves", every: 10 ms, frame: couch }
  smooth: { use: "ops/smooth.py:Smooth", inputs: { track: { from: waves.track, queue: 4 } } }
record: { topics: all }
'''


CLOCK = '''
"""An operator that lets the clock reach its output."""

import time

from stillpoint_rt.operator import Input, Operator, Output


class Smooth(Operator):
    """Adds the time of day."""

    track = Input("Track", queue=4)
    smooth = Output("Track", frame_of="track")

    def step(self, activation):
        track = activation.fresh("track")
        if track is not None:
            activation.send("smooth", track, position=track["position"] + time.time() * 1e-9)
'''


@pytest.fixture
def folder(tmp_path):
    """A folder with a pipeline of two operators in Python."""
    (tmp_path / "ops").mkdir()
    for name, text in (("waves", WAVES), ("smooth", SMOOTH), ("helper", HELPER)):
        (tmp_path / "ops" / f"{name}.py").write_text(text)
    (tmp_path / "p.yaml").write_text(PIPELINE)
    return tmp_path


def simulated(folder, *more):
    """Simulates one second; gives the report and the session."""
    report = json.loads(
        command("run", "p.yaml", "--clock", "simulated", "--for", "1s", "--record", "s", "--json", *more, cwd=folder)
    )
    return report, folder / report["session"]


def write(folder, text, name="smooth"):
    (folder / "ops" / f"{name}.py").write_text(textwrap.dedent(text))


def test_a_simulated_run_is_what_the_classes_compute_and_replays(folder):
    _, path = simulated(folder)
    session = st.Session(path, trust=True)
    waves = session["waves.track"].array()["position"]
    assert 95 <= len(waves) <= 101 and abs(waves[:, 2]).max() > 0.009
    expected, position = [], None
    for new in waves:
        position = new if position is None else position + 0.5 * (new - position)
        expected.append(position)
    np.testing.assert_array_equal(session["smooth.smooth"].array()["position"], expected)
    assert session["smooth.smooth"].frame_id == "couch"
    assert {"files/ops/smooth.py", "files/ops/helper.py"} <= set(session.attachments)

    # The sources of the session are what runs, not those of the folder.
    write(folder, "raise SystemExit", "helper")
    assert session.replay().identical
    assert "identical" in command("--trust", "replay", path)
    changed = session.what_if({"smooth.share": 0.25})
    assert changed.computed == ["smooth"] and "waves.track" in changed.unchanged


def test_the_code_of_a_session_is_not_run_unasked(folder):
    write(folder, HELPER + "\nopen('ran', 'w')\n", "helper")
    _, path = simulated(folder)
    (folder / "ran").unlink()
    with pytest.raises(st.StillpointError, match="trust=True"):
        st.Session(path).replay()
    assert "--trust" in outcome("replay", path, cwd=folder).stderr
    assert not (folder / "ran").exists()
    # Reading needs no code.
    assert len(st.Session(path)["smooth.smooth"].array())


def test_a_live_run_replays_to_the_bit(folder):
    report = json.loads(command("run", "p.yaml", "--for", "2s", "--record", "s", "--json", cwd=folder))
    assert report["balanced"] and not report["faults"], report
    session = st.Session(folder / report["session"], trust=True)
    assert len(session["smooth.smooth"]) > 100
    replay = session.replay()
    assert replay.identical, replay.verdict


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("x = 1", "there is no class Smooth"),
        ("def f(:", "ops/smooth.py:1: SyntaxError"),
        ("x = 1\ny = 1 / 0", "ops/smooth.py:2, in <module>: ZeroDivisionError"),
        ("import nothing_like_it", "ModuleNotFoundError"),
        (SMOOTH.replace('Input("Track"', 'Input("Trak"'), "there is no sample Trak"),
        (SMOOTH.replace("def step", "def stop"), "has no method `step`"),
        (SMOOTH.replace('frame_of="track"', 'frame_of="trak"'), "`trak`, which is not an input"),
        (SMOOTH.replace("smooth = Output", "journal = Output"), "another name"),
        (SMOOTH.replace("Param(0.5, min=0", "Param(0.5, min=0.7"), "share"),
    ],
)
def test_check_names_the_line_of_the_pipeline_and_of_the_source(folder, source, reason):
    write(folder, source)
    done = outcome("check", "p.yaml", cwd=folder)
    assert done.returncode == 2
    assert reason in done.stdout + done.stderr and "p.yaml:8:" in done.stdout + done.stderr


def test_parameters_and_ports_are_checked_as_for_any_kind(folder):
    assert "out of range" in outcome("check", "p.yaml", "--set", "smooth.share=2", cwd=folder).stderr
    assert "share" in outcome("check", "p.yaml", "--set", "smooth.sharp=1", cwd=folder).stderr
    assert outcome("check", "p.yaml", "--set", "waves.size=5 mm", cwd=folder).returncode == 0
    (folder / "p.yaml").write_text(PIPELINE.replace("from: waves.track", "from: waves.trak"))
    assert "no output `trak`" in outcome("check", "p.yaml", cwd=folder).stderr


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("raise ValueError('third')", "ops/smooth.py:8, in step: ValueError: third"),
        ("activation['track']['position'][0] = 1", "read-only"),
        ("activation.send('smooth', position=[1, 2])", "ops/smooth.py:8, in step: ValueError"),
        ("activation.send('smooth', nothing=1)", "Track has no field 'nothing'"),
        ("activation.send('other')", "there is no output 'other'"),
        ("activation['other']", "there is no input 'other'"),
    ],
)
def test_an_exception_is_a_failure_with_its_line_and_the_run_goes_on(folder, line, reason):
    write(
        folder,
        f"""\
        from stillpoint_rt.operator import Input, Operator, Output
        class Smooth(Operator):
            track = Input("Track")
            smooth = Output("Track", frame_of="track")
            def step(self, activation):
                activation.send("smooth", activation["track"])
                if activation.index == 3:
                    {line}
        """,
    )
    report, path = simulated(folder)
    assert reason in str(report["faults"]), report["faults"]
    sent = st.Session(path)["smooth.smooth"].array()
    assert sent["incarnation"].max() >= 1, "the operator began anew"
    assert st.Session(path, trust=True).replay().identical


def test_what_a_step_takes_from_elsewhere_is_found_by_a_replay(folder):
    write(folder, SMOOTH.replace("import helper", "import datetime, helper").replace(
        "position=self.position)", "position=self.position + 1e-9 * datetime.datetime.now().microsecond)"
    ))  # fmt: skip
    _, path = simulated(folder)
    replay = st.Session(path, trust=True).replay()
    assert not replay.identical and replay.first_difference["operator"] == "smooth"


def test_a_step_that_keeps_an_array_of_its_input_ends_its_process(folder):
    """Live, an input is lent: its memory is given back after the step."""
    write(
        folder,
        """\
        from stillpoint_rt.operator import Input, Operator, Output
        class Smooth(Operator):
            track = Input("Track", queue=4)
            smooth = Output("Track", frame_of="track")
            def step(self, activation):
                position = activation["track"]["position"]
                self.kept = position[:1] if activation.index == 20 else None
                activation.send("smooth", activation["track"])
        """,
    )
    report = json.loads(outcome("run", "p.yaml", "--for", "2s", "--record", "s", "--json", cwd=folder).stdout)
    text = str(report["faults"])
    assert "ops/smooth.py:5, in step: an array of an input is still held after activation 20" in text, report
    sent = st.Session(folder / report["session"])["smooth.smooth"].array()
    assert sent["incarnation"].max() >= 1, "the next incarnation took over"


def test_an_activation_that_is_over_gives_nothing(folder):
    write(
        folder,
        """\
        from stillpoint_rt.operator import Input, Operator, Output
        class Smooth(Operator):
            track = Input("Track")
            smooth = Output("Track", frame_of="track")
            last = None
            def step(self, activation):
                if self.last is not None:
                    self.last["track"]
                self.last = activation
        """,
    )
    report, _ = simulated(folder)
    assert "this activation is over" in str(report["faults"])


def test_clouds_pass_by_field_and_as_a_whole(folder):
    write(
        folder,
        """\
        import numpy as np
        from stillpoint_rt.operator import Input, Operator, Output, Param
        class Smooth(Operator):
            timer = "required"
            points = Param(100, min=1, max=100000)
            cloud = Output("PointCloud", framed=True, capacity="points")
            def step(self, activation):
                x = np.arange(self.points, dtype="f4")
                activation.send("cloud", xyz=np.stack([x, 2 * x, -x], axis=1), width=self.points, height=1)
        class Double(Operator):
            cloud = Input("PointCloud")
            twice = Output("PointCloud", frame_of="cloud", capacity=1000)
            def step(self, activation):
                cloud = activation["cloud"]
                points = cloud.elements.copy()
                points["xyz"][:, 2] *= 2
                assert cloud["width"] == len(cloud["xyz"]) and cloud["xyz"].shape[1] == 3
                activation.send("twice", points)
        """,
    )
    (folder / "p.yaml").write_text(
        """
stillpoint: 1
name: clouds
frames: { camera: { parent: couch, at: [0 mm, 0 mm, 500 mm] } }
operators:
  cloud: { use: "ops/smooth.py:Smooth", every: 100 ms, frame: camera }
  double: { use: "ops/smooth.py:Double", inputs: { cloud: cloud.cloud } }
record: { topics: all }
"""
    )
    _, path = simulated(folder)
    session = st.Session(path, trust=True)
    points, starts = session["double.twice"].elements()
    assert (np.diff(starts) == 100).all()
    x = np.arange(100, dtype="f4")
    np.testing.assert_array_equal(points["xyz"][:100], np.stack([x, 2 * x, -2 * x], axis=1))
    assert session.replay().identical
    report, _ = simulated(folder, "--set", "cloud.points=2000")
    assert "1000" in str(report["faults"]), "longer than the output was laid out for"


def test_check_runs_it_twice_and_names_the_topic_that_a_clock_reaches(folder):
    check = ("check", "p.yaml", "--determinism", "--for", "300ms", "--json")
    assert json.loads(command(*check, cwd=folder))["deterministic"] is True
    (folder / "ops" / "smooth.py").write_text(CLOCK)
    done = outcome(*check, cwd=folder)
    assert done.returncode == 3, done.stderr
    changed = [t["topic"] for t in json.loads(done.stdout)["differences"]["topics"] if not t["identical"]]
    assert "smooth.smooth" in changed
