"""Starts the command inside of this interpreter."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence

from . import _native

# Flags of the interpreter of child processes: no user packages, unbuffered output; -P (from 3.11): no module of the
# current folder. -I would ignore PYTHONHASHSEED.
_FLAGS = (["-P"] if sys.version_info >= (3, 11) else []) + ["-s", "-u"]
# What makes an operator compute the same bits in each process: the order of sets, one thread in products.
_ENVIRONMENT = {
    "PYTHONHASHSEED": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "PYTHONDONTWRITEBYTECODE": "1",
}


def main(arguments: Sequence[str]) -> int:
    """Runs the command with these arguments and gives its exit code. To be called once in a process.

    `--trust` before the subcommand runs the code of operators that a session keeps.
    """
    arguments = list(arguments)
    trusts = arguments[:1] == ["--trust"]
    if trusts:
        del arguments[0]
    is_child = bool(arguments) and arguments[0].startswith("__")
    # The command takes signals by itself; a supervisor ends its children.
    signal.signal(signal.SIGINT, signal.SIG_IGN if is_child else signal.SIG_DFL)
    lead = [*_FLAGS, "-m", "stillpoint_rt"]
    environment = list(_ENVIRONMENT.items())
    return _native.command(sys.executable, lead, environment, _native.__file__, arguments, trusts)
