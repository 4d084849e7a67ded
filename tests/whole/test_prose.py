"""The prose: American spelling everywhere, docstrings that begin well, and short sentences on the pages."""

import ast
import re
import subprocess
from pathlib import Path

BRITISH = re.compile(
    r"(?:col|neighb|behavi|fav|hon|flav|rig|hum|vap)our|cent(?:re|ring)|grey|artefact|licence|defence|judgement|metres?\b"
    r"|programmes?\b|towards|whilst|learnt|counter-clockwise|analys(?:e|ed|ing)\b|(?:label|model|travel|cancel|signal)l"
    r"(?:ed|ing)|(?:\w\w(?:al|im|an|er|ar|or|il|on|gn|tr)|quant|discret|emphas)is(?:e[drs]?|ing|ations?)\b"
)
ALLOWED = {("tests/frame/test_relight.py", "colour"): "a setting that a user invents"}
OPENINGS, MOST_WORDS, ROOT = ("Of", "What", "How", "So", "Where"), 25, Path(__file__).parents[2]


def texts(*patterns):
    """Return the text of each tracked file that matches a pattern, by name, without this file."""
    names = subprocess.run(["git", "ls-files", *patterns], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return {name: (ROOT / name).read_text() for name in names.split() if name != "tests/whole/test_prose.py"}


def british(files):
    words = {(name, word) for name, text in files.items() for word in re.findall(r"[a-z-]{4,}", text.lower())}
    return {(name, word) for name, word in words if BRITISH.search(word)}


def bad_docstrings(source):
    """Return docstrings with one of OPENINGS, and those of public functions whose first line is no sentence."""
    tree = list(ast.walk(ast.parse(source)))
    strings = [str(n.value.value) for n in tree if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)]
    opened = [text for text in strings if text.split(None, 1)[0] in OPENINGS]
    functions = [n for n in tree if isinstance(n, ast.FunctionDef) and not n.name.startswith("_")]
    return opened + [text for n in functions if not (text := ast.get_docstring(n) or ".").split("\n")[0].endswith(".")]


def long_sentences(page):
    """Return the sentences over MOST_WORDS outside code, tables, headings and quotes. A span of code is one word."""
    page = re.sub(r"(?ms)^( *)(```+).*?^\1\2", "", page)
    page = re.sub(r"`[^`]*`", "code", re.sub(r"(?m)^(?: {4}| *[|#<>]).*$", "\n", page))
    blocks = re.split(r"\n\s*\n|\n *(?:[-*]|\d+\.) ", re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", page))
    found = [s for block in blocks for s in re.split(r"(?<=[.!?])[)\"*]*\s+", " ".join(block.split()))]
    return [sentence for sentence in found if len(re.findall(r"\S*[A-Za-z]\S*", sentence)) > MOST_WORDS]


def test_spelling_is_american():
    assert british(texts("*.py", "*.md", "*.toml", "*.cl", "*.h", "*.frag", "*.vert", "Makefile", ".ci")) == {*ALLOWED}
    assert british({"a": "Centre = normalised(in_x); otherwise arise"}) == {("a", "centre"), ("a", "normalised")}


def test_docstrings_begin_well():
    assert {name: bad for name, text in texts("splatcl/*.py").items() if (bad := bad_docstrings(text))} == {}
    assert len(bad_docstrings('def f():\n  """Fold\n  it."""\ndef _g():\n  """How so."""\ndef h():\n  """Do."""')) == 2


def test_sentences_are_short():
    pages = texts("README.md", "docs/*.md", ":!docs/decisions/0008-sentences.md")  # a record of old sentences
    assert len(pages) > 15 and {name: found for name, page in pages.items() if (found := long_sentences(page))} == {}
    assert long_sentences(f"\n- {'word ' * 25}`x y`.\n- {'word ' * 24}[and](more). Not so.") == [f"{'word ' * 25}code."]
