"""The blocks of the guide, in the order of the page: shell commands, files, and Python in one namespace."""

import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "python.md"


def test_the_blocks_of_the_guide_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```(sh|python|yaml)\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert len(blocks) >= 9
    names: dict = {}
    for language, text in blocks:
        if language == "sh":
            for line in text.strip().splitlines():
                line = line.replace("python -m", f"{sys.executable} -m", 1)
                subprocess.run(line, shell=True, check=True, capture_output=True)
        elif text.startswith("# ") and (name := text.splitlines()[0][2:]).endswith((".py", ".yaml")):
            Path(name).parent.mkdir(exist_ok=True)
            Path(name).write_text(text)
        else:
            exec(compile(text, str(PAGE), "exec"), names)
    assert names["session"].replay().identical
    assert names["own"].fun < 1.05 * names["shipped"].cost
