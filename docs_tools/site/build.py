"""Building the site from the pages; it fails where a link leads nowhere.

The pages are made to be read in the repository too, so they link to its files (`../launch/robot.yaml`). The site has
the same folders: the README is its first page, and each file that a page links to comes along.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import msgspec

ROOT = Path(__file__).parents[2]

SECTIONS = {
    "Begin here": ("index", "tutorial", "create", "node", "own_base", "real_robot", "testing", "packages"),
    "From ROS 2": ("from_ros2", "moving_from_ros2", "from_ros2_launch", "ros2_bridge"),
    "Robots": (
        "running", "launch", "driving", "simulation", "sensors", "localization",
        "several_robots", "fleets", "access", "hosts", "security", "systemd", "kubernetes", "tools", "dashboard",
        "foxglove", "viewing", "debugging",
    ),
    "Recordings": ("recording", "playing", "recordings", "flight_recorder", "replay_test", "batch"),
    "Nodes": (
        "messages", "services", "actions", "parameters", "lifecycle",
        "transforms", "pictures", "performance", "clients",
    ),
    "Inside": ("architecture",),
}  # fmt: skip
"""The pages of docs/ by section. One that is not named here stands in the last section."""

_LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s#]+)")
_FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


class Broken(Exception):
    """The site cannot be built, or is not as it has to be."""


def pages(root: Path) -> list[Path]:
    """The pages of a repository, relative to it."""
    found = [root / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    found += [*(root / "docs").rglob("*.md"), *(root / "benchmarks").glob("*.md"), *(root / "examples").glob("*.md")]
    return sorted(page.relative_to(root) for page in found if page.exists())


def place_of(page: Path) -> Path:
    """Where a page stands in the site: a README is the first page of its folder."""
    return page.with_name("index.md") if page.name == "README.md" else page


def stage(root: Path, folder: Path) -> None:
    """Lay the pages of a repository into a folder, with all that they link to.

    Raises:
        Broken: a link leads to nothing.
    """
    for page in pages(root):
        text = (root / page).read_text(encoding="utf-8")
        target = folder / place_of(page)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(_relinked(text, root, page, folder), encoding="utf-8")


def _relinked(text: str, root: Path, page: Path, folder: Path) -> str:
    """The text of a page as it is in the site; what it links to is copied, where it is no page."""

    def link(match: re.Match[str]) -> str:
        before, target = match.groups()
        if re.match(r"[a-z]+:", target):
            return match[0]
        file = (root / page.parent / target).resolve()
        if file.is_dir() and (file / "README.md").exists():
            return f"{before}{target.rstrip('/')}/index.md"
        if not file.is_file() or not file.is_relative_to(root.resolve()):
            raise Broken(f"{page}: {target} is no file of the repository")
        if file.suffix == ".md":
            return before + str(place_of(Path(target)))
        copy = folder / file.relative_to(root.resolve())
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
        return match[0]

    outside = _FENCE.split(text)
    return "".join(
        _LINK.sub(link, part) + fence for part, fence in zip(outside, [*_FENCE.findall(text), ""], strict=True)
    )


def navigation(root: Path) -> list[dict[str, object]]:
    """The list of pages, by section, in the words of the generator's settings."""
    left = {str(page.relative_to("docs").with_suffix("")): page for page in pages(root) if page.parts[0] == "docs"}
    listed: list[dict[str, object]] = [{"robo": "index.md"}]
    for section, names in SECTIONS.items():
        listed.append({section: [_entry(root, left.pop(name)) for name in names if name in left]})
    rest = [_entry(root, page) for _, page in sorted(left.items()) if page.parent == Path("docs")]
    if rest:
        listed.append({"More": rest})
    reference = [_entry(root, page) for _, page in sorted(left.items()) if page.parent != Path("docs")]
    if reference:
        listed.append({"Reference": reference})
    others = [_entry(root, page) for page in pages(root) if page.parts[0] != "docs" and page != Path("README.md")]
    return [*listed, {"Project": others}]


def _entry(root: Path, page: Path) -> dict[str, str]:
    title = re.search(r"^# (.+)$", (root / page).read_text(encoding="utf-8"), re.MULTILINE)
    if title is None:
        raise Broken(f"{page} has no title")
    return {title[1].replace("`", ""): place_of(page).as_posix()}


def settings(root: Path) -> str:
    """The generator's settings, with the list of pages."""
    text = (root / "docs_tools" / "site" / "zensical.toml").read_text(encoding="utf-8")
    return text.replace("[project]\n", f"[project]\nnav = {_toml(navigation(root))}\n", 1)


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_toml(key)} = {_toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return msgspec.json.encode(value).decode()


class _References(HTMLParser):
    """What a page of the site refers to, and what in it can be referred to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        """What a browser fetches by itself."""
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        """Note what a tag refers to."""
        about = {name: value or "" for name, value in attrs}
        if "id" in about:
            self.anchors.add(about["id"])
        if tag == "a" and "href" in about:
            self.links.append(about["href"])
        elif tag == "link" and about.get("rel") not in ("canonical", "prev", "next"):
            self.loaded.append(about.get("href", ""))
        elif "src" in about:
            self.loaded.append(about["src"])


def faults(site: Path) -> Iterable[str]:
    """What is wrong with a site that was built: links to nothing, and what is fetched from other hosts."""
    read = {file: _References(file.read_text(encoding="utf-8")) for file in sorted(site.rglob("*.html"))}
    for file, found in read.items():
        if file.name == "404.html":  # its links count from the root of a server
            continue
        for target in found.loaded:
            if re.match(r"(https?:)?//", target):
                yield f"{file.relative_to(site)} fetches {target}"
        for target in (*found.links, *found.loaded):
            path, _, anchor = unquote(target).partition("#")
            if re.match(r"[a-z]+:|//", path) or target in ("#", ""):
                continue
            end = (file.parent / path).resolve() if path else file
            end = end / "index.html" if end.is_dir() else end
            if not end.exists():
                yield f"{file.relative_to(site)}: {target} leads nowhere"
            elif anchor and end in read and anchor not in read[end].anchors and anchor != "__skip":
                yield f"{file.relative_to(site)}: there is no {target}"


def build(root: Path, target: Path) -> None:
    """Build the site.

    Args:
        root: the repository.
        target: the folder to make; what is in it goes.

    Raises:
        Broken: something is wrong with the pages, or with the site.
    """
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder).resolve()
        stage(root, work / "pages")
        (work / "zensical.toml").write_text(settings(root), encoding="utf-8")
        command = [sys.executable, "-m", "zensical", "build", "--strict", "--config-file", str(work / "zensical.toml")]
        done = subprocess.run(command, cwd=work, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Broken(f"{done.stdout}{done.stderr.partition('Traceback')[0]}")
        wrong = list(faults(work / "site"))
        if wrong:
            raise Broken("\n".join(wrong))
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(work / "site", target)
