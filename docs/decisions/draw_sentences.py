"""Draw sentences of the pages, docstrings and comments by a seed, to read them aloud: the sample of decision 0008.

``python docs/decisions/draw_sentences.py --seed 11 --number 200`` prints one sentence a line, with its file.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parents[2]
LEAST_WORDS = 5


def main() -> None:
    """Print the sample."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--number", type=int, default=200)
    given = parser.parse_args()
    every = sorted({(name, sentence) for name, text in texts() for sentence in sentences(text)})
    for name, sentence in sorted(Random(given.seed).sample(every, given.number)):
        print(f"{name}: {sentence}")


def texts() -> Iterator[tuple[str, str]]:
    """Yield the prose of every page, Python file and kernel, by the file's name."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    for path in pages:
        if "decisions" not in path.parts:
            yield name_of(path), prose(path.read_text())
    for path in (ROOT / "splatcl").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                yield name_of(path), re.split(r"\n(?=\w+\n-{4,})", ast.get_docstring(node) or "")[0]
    for path in (*(ROOT / "kernels").rglob("*.cl"), *(ROOT / "kernels").rglob("*.h")):
        blocks = re.findall(r"^(?:// .*\n)+", path.read_text(), re.M)
        yield name_of(path), "\n\n".join(block.replace("// ", "") for block in blocks)


def prose(page: str) -> str:
    """Return a page without code, tables, headings and the targets of links."""
    page = re.sub(r"```.*?```", "", page, flags=re.DOTALL)
    page = re.sub(r"^[|#].*$", "", page, flags=re.MULTILINE)
    return re.sub(r"!?\[([^]]*)\]\([^)]*\)", r"\1", page)


def name_of(path: Path) -> str:
    """Return the path from the root of the checkout."""
    return path.relative_to(ROOT).as_posix()


def sentences(text: str) -> Iterator[str]:
    """Yield the sentences of a text, each on one line."""
    for paragraph in re.split(r"\n\s*\n|\n- ", text):
        for sentence in re.split(r"(?<=[.!?]) +(?=[A-Z`\[])", " ".join(paragraph.split())):
            if len(sentence.split()) >= LEAST_WORDS and sentence.endswith((".", "!", "?")):
                yield sentence.removeprefix("- ")


if __name__ == "__main__":
    main()
