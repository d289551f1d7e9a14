"""Sessions that the tests read: made once by the package's own command."""

import subprocess
import sys
from pathlib import Path

import pytest
import stillpoint_rt as st


def outcome(*arguments, cwd=None):
    """Runs the command of the package; gives its end."""
    line = [sys.executable, "-m", "stillpoint_rt", *map(str, arguments)]
    return subprocess.run(line, cwd=cwd, capture_output=True, text=True)


def command(*arguments, cwd=None):
    """The same for a command that must succeed; gives what it prints on standard output."""
    done = outcome(*arguments, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def recorded(tmp_path_factory) -> Path:
    """Two seconds of the default pipeline with simulated time."""
    folder = tmp_path_factory.mktemp("recorded") / "session"
    folder.parent.mkdir(exist_ok=True)
    command("run", "--clock", "simulated", "--for", "2s", "--record", folder.parent / "sessions", cwd=folder.parent)
    (session,) = (folder.parent / "sessions").iterdir()
    return session


@pytest.fixture(scope="session")
def session(recorded) -> st.Session:
    return st.Session(recorded)
