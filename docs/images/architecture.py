"""Draw the way of the data through the passes from the sources of splatcl/opencl, as docs/images/architecture.svg.

A row is a pass, in the order of the import-linter contract in pyproject.toml. A column is a record of
splatcl/opencl/state/buffers.py. A pass takes the records of its parameters' annotations. It makes the record that it
returns, or else the first parameter that its docstring names.
"""

from __future__ import annotations

import ast
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
OPENCL = ROOT / "splatcl" / "opencl"
SPLATS, IMAGE = "DeviceSplats", "image"
BOX_WIDTH, BOX_HEIGHT, ROW, COLUMN, MARGIN, TOP = 270, 76, 94, 112, 20, 66
STYLE = (
    "text{font:13px sans-serif;fill:#1b1f24}.name{font-weight:700;font-size:15px}.path{font-size:11px;fill:#57606a}"
    ".box{fill:#f6f8fa;stroke:#57606a}.record{font-weight:700;fill:#0550ae}.line{stroke:#0550ae;stroke-width:2}"
    ".row{stroke:#d0d7de;stroke-dasharray:3 3}.makes{fill:#0550ae}.takes{fill:#fff;stroke:#0550ae;stroke-width:2}"
)


@dataclass(frozen=True)
class Pass:
    """One pass: its word, and the records that it takes and makes."""

    name: str
    takes: tuple[str, ...]
    makes: str


def record_parts() -> dict[str, tuple[str, ...]]:
    """Return the records of state/buffers.py by name, each with the records that its fields hold."""
    classes = [n for n in ast.parse((OPENCL / "state" / "buffers.py").read_text()).body if isinstance(n, ast.ClassDef)]
    fields = {n.name: [ast.unparse(f.annotation) for f in n.body if isinstance(f, ast.AnnAssign)] for n in classes}
    return {name: tuple(part for part in parts if part in fields) or (name,) for name, parts in fields.items()}


def order() -> list[str]:
    """Return the words of the passes, in order."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(c["layers"] for c in contracts if c.get("containers") == ["splatcl.opencl.passes"])
    return [name for layer in reversed(layers) for name in layer.split(" | ")]


def passes() -> list[Pass]:
    """Return every pass, in order."""
    parts = record_parts() | {SPLATS: (SPLATS,)}
    found = []
    for name in order():
        body = ast.parse((OPENCL / "passes" / f"{name}.py").read_text()).body
        function = next(n for n in body if isinstance(n, ast.FunctionDef) and n.name == name)
        records = {a.arg: ast.unparse(a.annotation or a).removesuffix(" | None") for a in function.args.args}
        returned = re.sub(r"Iterator\[(.*)\]", r"\1", ast.unparse(function.returns or function))
        named = re.findall(r"`(\w+)`", (ast.get_docstring(function) or "").partition("\n")[0])
        made = next((records[n] for n in named if records.get(n) in parts), IMAGE)
        taken = dict.fromkeys(part for record in records.values() for part in parts.get(record, ()))
        found.append(Pass(name, tuple(taken), returned if returned in parts else made))
    return found


def drawn() -> str:
    """Return the picture as SVG."""
    every = passes()
    columns = [SPLATS, *dict.fromkeys(one.makes for one in every if one.makes != IMAGE), IMAGE]
    x = {record: MARGIN + BOX_WIDTH + COLUMN * (k + 0.6) for k, record in enumerate(columns)}
    y = {one.name: TOP + ROW * (k + 0.5) for k, one in enumerate(every)}
    width, height = x[IMAGE] + COLUMN * 0.6, TOP + ROW * len(every) + MARGIN
    shapes = []
    for record in columns:
        at = [y[one.name] for one in every if record in (*one.takes, one.makes)]
        start = TOP - 16 if record == SPLATS else min(at)
        shapes.append(f'<line class="line" x1="{x[record]:g}" y1="{start:g}" x2="{x[record]:g}" y2="{max(at):g}"/>')
        shapes.append(text("record", x[record], TOP - 28, record))
    for one in every:
        used = [record for record in columns if record in (*one.takes, one.makes)]
        left, right = MARGIN + BOX_WIDTH, max((x[record] for record in used), default=0)
        shapes.append(f'<line class="row" x1="{left}" y1="{y[one.name]:g}" x2="{right:g}" y2="{y[one.name]:g}"/>')
        for record in used:
            role = "makes" if record == one.makes else "takes"
            shapes.append(f'<circle class="{role}" cx="{x[record]:g}" cy="{y[one.name]:g}" r="7"/>')
        shapes += box(one.name, y[one.name])
    legend = [("makes", 0, "makes or fills it"), ("takes", 150, "takes it")]
    for role, offset, words in legend:
        shapes.append(f'<circle class="{role}" cx="{MARGIN + 10 + offset}" cy="{TOP - 32}" r="7"/>')
        shapes.append(f'<text x="{MARGIN + 24 + offset}" y="{TOP - 28}">{words}</text>')
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img">',
            f"<title>The passes of splatcl/opencl, and the records between them</title><style>{STYLE}</style>",
            f'<rect width="{width:g}" height="{height:g}" fill="#ffffff"/>',
            *shapes,
            "</svg>\n",
        ]
    )


def box(name: str, middle: float) -> list[str]:
    """Return the box of a pass, with its places."""
    kernel = next(path for path in sorted((ROOT / "kernels").rglob(f"{name}.*")) if path.suffix in (".cl", ".h"))
    oracle = f"splatcl/oracle/{name}.py"
    lines = [f"splatcl/opencl/passes/{name}.py", kernel.relative_to(ROOT).as_posix()]
    lines.append(oracle if (ROOT / oracle).exists() else "no oracle")
    place = f'x="{MARGIN}" y="{middle - BOX_HEIGHT / 2:g}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}"'
    center = MARGIN + BOX_WIDTH / 2
    return [
        f'<rect class="box" {place} rx="8"/>',
        text("name", center, middle - 19, name),
        *(text("path", center, middle - 2 + 15 * k, line) for k, line in enumerate(lines)),
    ]


def text(style: str, x: float, y: float, words: str) -> str:
    """Return words around a point, pixels."""
    return f'<text class="{style}" x="{x:g}" y="{y:g}" text-anchor="middle">{words}</text>'


if __name__ == "__main__":
    (ROOT / "docs" / "images" / "architecture.svg").write_text(drawn())
