"""Render every model of a folder into one picture, docs/contact_sheet.png: ``make contact-sheet MODELS=folder``."""

from __future__ import annotations

import shlex
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageDraw

from splatcl.cli import main

SIZE, LABEL, COLUMNS = 320, 16, 6
VIEW = "--azimuth 25 --elevation 15"
VIEWS = {  # where the file's axes or its one scanned side want another view
    "1.2-with-color.las": "--elevation 40",
    "1.2-with-color.ptx": "--elevation 40",
    "ArmadilloBack_1.ply": "--azimuth 180",
    "armadillo.off": "--azimuth 200 --elevation 10",
    "bun0.pcd": "--azimuth 180",
    "cloud_bin_0_feature.pcd": "--up -y --azimuth 0 --exposure 2",
    "dino.off": "--up z --azimuth 30 --elevation 10",
    "frag_color_small.ply": "--elevation 60",
    "oni.pwn": "--azimuth 10",
    "poste_france.xyz": "--up z --azimuth 90",
    "sample_c.las": "--elevation 40",
    "simple.laz": "--elevation 40",
    "spot.obj": "--azimuth 205",
    "train-1000.gs.ply": "--up -y --elevation 10",
}


def render(model: Path, png: Path) -> None:
    """Render one model as the command line does."""
    options = f"--size {SIZE}x{SIZE} {VIEWS.get(model.name, VIEW)}"
    status = main(["render", str(model), "--png", str(png), *shlex.split(options)])
    if status:
        raise SystemExit(f"{model} does not render")


def sheet(folder: Path, output: Path) -> None:
    """Write the contact sheet of all models in `folder`."""
    models = sorted((p for p in folder.iterdir() if p.is_file() and p.suffix != ".tsv"), key=lambda p: p.name.lower())
    rows = -(-len(models) // COLUMNS)
    picture = Image.new("RGB", (COLUMNS * SIZE, rows * (SIZE + LABEL)), "white")
    draw = ImageDraw.Draw(picture)
    with tempfile.TemporaryDirectory() as scratch:
        for i, model in enumerate(models):
            png = Path(scratch) / "model.png"
            render(model, png)
            x, y = i % COLUMNS * SIZE, i // COLUMNS * (SIZE + LABEL)
            rendered = Image.open(png)
            picture.paste(rendered, (x, y + LABEL), rendered)
            draw.text((x + 4, y + 2), model.name, fill="black")
    picture.save(output, optimize=True)


if __name__ == "__main__":
    sheet(Path(sys.argv[1]), Path(__file__).parent / "contact_sheet.png")
