"""Damaged recordings: errors of robo's, no traceback, bounded memory. Another seed each time; the output says it."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_damaged_files_are_refused_or_read_and_nothing_else() -> None:
    paths = [str(ROOT), str(ROOT / "messages"), str(ROOT / "services")]
    result = subprocess.run(
        [sys.executable, "-m", "tests.hostile_bags", "--files", "30"],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)}, capture_output=True, text=True, timeout=150,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
