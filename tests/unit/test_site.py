"""The site that is made of the pages; CI builds it."""

import re
from pathlib import Path

import pytest

from docs_tools.site.build import Broken, faults, navigation, pages, settings, stage
from docs_tools.site.images import picture
from tests.pages import ROOT


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A small one with links of every kind."""
    root = tmp_path / "repository"
    for file, text in {
        "README.md": "# It\n[node](docs/node.md#depth) [examples](examples)\n",
        "docs/node.md": "# The `node`\n[home](../README.md) [m](../launch/a.yaml) [z](https://zenoh.io)\n",
        "docs/reference/types.md": "# Types\n",
        "docs/fresh.md": "# Fresh\n```yaml\n[a](b)\n```\n",
        "docs_tools/site/zensical.toml": '[project]\nsite_name = "it"\n',
        "examples/README.md": "# Examples\n",
        "launch/a.yaml": "groups: {}\n",
        "launch/b.yaml": "groups: {}\n",
    }.items():
        (root / file).parent.mkdir(parents=True, exist_ok=True)
        (root / file).write_text(text)
    return root


def test_a_page_brings_what_it_links_to(repository: Path, tmp_path: Path) -> None:
    staged = tmp_path / "staged"
    stage(repository, staged)
    assert (staged / "index.md").read_text() == "# It\n[node](docs/node.md#depth) [examples](examples/index.md)\n"
    assert "[home](../index.md) [m](../launch/a.yaml) [z](https://zenoh.io)" in (staged / "docs/node.md").read_text()
    assert "[a](b)" in (staged / "docs/fresh.md").read_text()
    assert [file.name for file in (staged / "launch").iterdir()] == ["a.yaml"]


@pytest.mark.parametrize("target", ["no.md", "../../outside", "../launch"])
def test_a_link_to_nothing_is_refused(repository: Path, tmp_path: Path, target: str) -> None:
    (tmp_path / "outside").touch()
    (repository / "docs" / "node.md").write_text(f"# Node\n[x]({target})\n")
    with pytest.raises(Broken, match=r"docs/node.md: \S+ is no file of the repository"):
        stage(repository, tmp_path / "staged")


def test_every_page_is_listed(repository: Path) -> None:
    listed = navigation(repository)
    assert listed[0] == {"robo": "index.md"}
    assert {"Begin here": [{"The node": "docs/node.md"}]} in listed
    assert listed[-3:] == [
        {"More": [{"Fresh": "docs/fresh.md"}]},
        {"Reference": [{"Types": "docs/reference/types.md"}]},
        {"Project": [{"Examples": "examples/index.md"}]},
    ]
    assert settings(repository).startswith('[project]\nnav = [{"robo" = "index.md"}, {"Begin here" = [{"The node" = ')


def test_all_of_it_can_be_laid_out(tmp_path: Path) -> None:
    stage(ROOT, tmp_path)
    text = settings(ROOT)
    assert all((tmp_path / page).exists() for page in ("index.md", "docs/index.md", "launch/robot.yaml"))
    assert text.count(".md") == len(pages(ROOT))


def test_what_is_wrong_with_a_site_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<script src="https://x.example/a.js"></script><link rel="stylesheet" href="a.css"><h1 id="top">'
        '<a href="b.html"><a href="b.html#here"><a href="c.html"><a href="#top"><a href="https://x.example">'
    )
    (tmp_path / "b.html").write_text('<a href="a.html#top">')
    assert list(faults(tmp_path)) == [
        "a.html fetches https://x.example/a.js",
        "a.html: there is no b.html#here",
        "a.html: c.html leads nowhere",
        "a.html: a.css leads nowhere",
    ]


@pytest.mark.parametrize("image", sorted((ROOT / "docs" / "images").iterdir()), ids=lambda image: image.name)
def test_a_picture_is_small_and_fetches_nothing(image: Path) -> None:
    data = image.read_bytes()
    assert len(data) < 150_000
    if image.suffix == ".png":
        return
    text = data.decode()
    assert not re.search(r"""(url\(|href=|src=)["']?(https?:)?//""", text)


def test_a_terminal_is_drawn_without_foreign_fonts() -> None:
    drawn = picture("title", ("robo ps", "\x1b[32mready\x1b[0m\n"), ("robo down", "r1 is down\n"))
    assert "ready" in drawn
    assert "r1&#160;is&#160;down" in drawn
    assert "@font-face" not in drawn
