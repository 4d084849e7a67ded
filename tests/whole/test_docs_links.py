"""Every link, picture and anchor of every page has a target; every path and every option of a command exists."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

import pytest
from cyclopts import CycloptsError
from helpers.paths import ROOT

from splatcl.cli import app

LINK = re.compile(r"\]\(<?([^()\s>]+)>?(?: \"[^\"]*\")?\)|<(?:img|a)\b[^>]*\b(?:src|href)=\"([^\"]+)\"")
OUTSIDE = re.compile(r"[a-z][a-z0-9+.-]*:|//")

PATH = re.compile(r"(?<![\w./{-])(?:(?:splatcl|kernels|docs|tests|examples|reference_images)/[\w./-]*\w|\.ci/\w+)")
PLACEHOLDER = re.compile(r"[/_]W\.")
"""Pattern of a pass' name, in the table of its four places."""
ELSEWHERE = ("CHANGELOG.md", "reference_images/scans/README.md")
"""Pages that name paths of earlier versions or of other repositories."""


def tracked(root: Path) -> set[str]:
    """Return the files that git tracks or does not ignore, and their folders, relative to the root."""
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listing, cwd=root, check=True, capture_output=True, text=True).stdout.split("\0")
    files = [Path(name) for name in names if name and (root / name).exists()]
    return {path.as_posix() for file in files for path in (file, *file.parents)}


def prose(text: str) -> str:
    """Return a page without its blocks and spans of code."""
    text = re.sub(r"^( *)(```+|~~~+).*?^\1\2", "", text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"(`+)(?!`).*?(?<!`)\1(?!`)", "", text)


def anchors(page: str) -> set[str]:
    """Return the anchors of a page: `<a id>`, and headings as GitHub writes them, the second of a name with -1."""
    names: dict[str, int] = {}
    found = set(re.findall(r"<a (?:id|name)=\"([^\"]+)\"", page))
    text = re.sub(r"^( *)(```+|~~~+).*?^\1\2", "", page, flags=re.DOTALL | re.MULTILINE)
    for heading in re.findall(r"^#{1,6} +(.*?) *#*$", text, re.MULTILINE):
        shown = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", shown.lower()).replace(" ", "-")
        found.add(f"{slug}-{names[slug]}" if slug in names else slug)
        names[slug] = names.get(slug, 0) + 1
    return found


def broken(root: Path) -> Iterator[str]:
    """Yield `page: target` for every relative link without a target."""
    files = tracked(root)
    for name in sorted(file for file in files if file.endswith(".md")):
        page = (root / name).read_text()
        for target in (one or other for one, other in LINK.findall(prose(page))):
            if OUTSIDE.match(target):
                continue
            path, _, anchor = unquote(target).partition("#")
            aim = (root / name).parent / path if path else root / name
            place = aim.resolve()
            inside = place.is_relative_to(root) and place.relative_to(root).as_posix() in files
            if not inside or (anchor and anchor not in anchors(place.read_text())):
                yield f"{name}: {target}"


def lost_paths(root: Path) -> Iterator[str]:
    """Yield `page: path` for every path in a page's text that the repository lacks."""
    files = tracked(root)
    for name in sorted(file for file in files if file.endswith(".md") and file not in ELSEWHERE):
        text = re.sub(r"\]\([^)]*\)", "]", (root / name).read_text())
        for path in PATH.findall(text):
            if path not in files and not PLACEHOLDER.search(path):
                yield f"{name}: {path}"


def commands(page: Path) -> list[list[str]]:
    """Return the words after `splatcl` of every `$ splatcl` of a page, up to # or |."""
    blocks = re.findall(r"^```console\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [shlex.split(re.split(r"[#|]", line)[0])[2:] for line in lines if line.startswith("$ splatcl ")]


def test_every_link_leads_somewhere():
    assert list(broken(ROOT)) == []


def test_every_path_exists():
    assert list(lost_paths(ROOT)) == []


def test_every_command_can_be_parsed():
    pages = [ROOT / name for name in sorted(tracked(ROOT)) if name.endswith(".md")]
    every = [words for page in pages for words in commands(page)]
    assert len(every) > 30
    for words in every:
        app.parse_args(words, exit_on_error=False, print_error=False)


def test_every_picture_is_shown_on_a_page():
    pages = [ROOT / name for name in tracked(ROOT) if name.endswith(".md")]
    shown = {(page.parent / target).resolve() for page in pages for target, _ in LINK.findall(prose(page.read_text()))}
    assert {picture for picture in (ROOT / "docs" / "images").glob("*.png") if picture not in shown} == set()


def test_wrong_links_are_found(tmp_path):
    """The first five links are right. Mutation: `inside = True`."""
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "page.md").write_text(
        "# One `word`, two\n\n## Again\n\n## Again\n\n```sh\n# no heading\n```\n"
    )
    (tmp_path / "README.md").write_text(
        "[a](docs/page.md) [b](docs/page.md#one-word-two) [c](docs/page.md#again-1) [d](https://x.y/z.md) [e](docs)\n"
        "[f](page.md) ![g](docs/none.png) [h](docs/page.md#no-heading) [i](#nothing) [j](../outside.md)\n"
        '<img src="lost.png"> [k](docs/PAGE.md) `[l](code.md)`\n\n```\n[m](block.md)\n```\n[n](docs/page.md#again-2)\n'
    )
    wrong = ["page.md", "docs/none.png", "docs/page.md#no-heading", "#nothing", "../outside.md", "lost.png"]
    wrong += ["docs/PAGE.md", "docs/page.md#again-2"]
    assert list(broken(tmp_path.resolve())) == [f"README.md: {target}" for target in wrong]


def test_lost_paths_are_found(tmp_path):
    """Mutation: `PATH` without its list of folders. Another test checks links."""
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    (tmp_path / "kernels" / "passes").mkdir(parents=True)
    (tmp_path / "kernels" / "passes" / "bin.cl").write_text("")
    (tmp_path / "README.md").write_text(
        "kernels/passes/bin.cl, `kernels/passes/` kernels/W.cl kernels/hide.cl `tests/test_gone.py`\n"
        "[x](docs/x.md) .ci/lost\n"
    )
    wrong = ["kernels/hide.cl", "tests/test_gone.py", ".ci/lost"]
    assert list(lost_paths(tmp_path.resolve())) == [f"README.md: {path}" for path in wrong]


def test_wrong_commands_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```console\n$ splatcl render a.ply --azimut 3  # no such option\n$ make demo\n```\n")
    assert commands(page) == [["render", "a.ply", "--azimut", "3"]]
    with pytest.raises(CycloptsError):
        app.parse_args(commands(page)[0], exit_on_error=False, print_error=False)
