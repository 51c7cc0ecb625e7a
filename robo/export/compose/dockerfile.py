"""A Dockerfile for nodes of one's own, on top of robo's image."""

import re
from pathlib import Path

IMAGE = "robo:latest"
"""robo's own image, as its Dockerfile's first lines call it."""

TEXT = """\
# Nodes of your own in robo's image: the Python package of this folder, with its dependencies and entry points.
# A .dockerignore keeps .venv and .git out of the copy.
FROM robo
USER root
COPY . /src
RUN pip install --no-cache-dir /src
USER robo
"""

_ON_ROBO = re.compile(r"^\s*FROM\s+robo(:\S+)?(\s|$)", re.MULTILINE | re.IGNORECASE)


def image_for(recipe: Path) -> str:
    """What the image of a Dockerfile is to be called.

    One that is built on robo's image has its folder's name: it must not take the name of what it is built on.
    """
    if not _ON_ROBO.search(recipe.read_text(encoding="utf-8", errors="replace")):
        return IMAGE
    name = re.sub(r"[^a-z0-9]+", "-", recipe.absolute().parent.name.lower()).strip("-")
    return f"{name if name not in ('', 'robo') else 'my-robot'}:latest"
