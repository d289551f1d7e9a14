"""The command `stillpoint`, inside of the interpreter: `python -m stillpoint_rt run pipeline.yaml`."""

import sys

from ._command import main

sys.exit(main(sys.argv[1:]))
