"""Packages from npm that tests use where somebody has them: beside the checkout, or in NODE_PATH."""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def node_with(packages: Sequence[str]) -> str:
    """The program `node`, which has these packages; the test is skipped where it, or one of them, is missing."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    if _resolved(node, packages) is None:
        pytest.skip(f"npm install --no-save {' '.join(packages)}: not all are there, nor in NODE_PATH")
    return node


def file_of(name: str) -> Path:
    """A file of a package, such as `axe-core/axe.min.js`; the test is skipped where it is missing."""
    node = node_with([name])
    return Path(_resolved(node, [name]) or "")


def _resolved(node: str, names: Sequence[str]) -> str | None:
    """The path of the last of them; None where one is missing."""
    script = "let at; for (const name of process.argv.slice(1)) at = require.resolve(name); console.log(at)"
    done = subprocess.run(
        [node, "-e", script, *names], cwd=ROOT, capture_output=True, text=True, check=False, timeout=60
    )
    return done.stdout.strip() if done.returncode == 0 else None
