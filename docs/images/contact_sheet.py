"""Render every model of a folder into one picture, contact_sheet.png: ``make contact-sheet MODELS=folder``."""

from __future__ import annotations

import shlex
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageDraw

from splatcl.cli import main

SIZE, LABEL, COLUMNS = 320, 16, 6
VIEW = "--azimuth 25 --elevation 15"
VIEWS = {  # where axes that the file does not tell, or its one scanned side, want another view
    "1.2-with-color.las": "--elevation 40",
    "1.2-with-color.ptx": "--elevation 40",
    "ArmadilloBack_1.ply": "--azimuth 180",
    "armadillo.off": "--azimuth 200 --elevation 10",
    "bun0.pcd": "",
    "cloud_bin_0_feature.pcd": "--up -y --azimuth 0 --exposure 2",
    "dino.off": "--up z --azimuth 30 --elevation 10",
    "frag_color_small.ply": "--elevation 60",
    "oni.pwn": "--azimuth 10",
    "poste_france.xyz": "--up z --azimuth 90",
    "sample_c.las": "--elevation 40",
    "simple.laz": "--elevation 40",
    "spot.obj": "--azimuth 205",
    "train-1000.gs.ply": "--elevation 10",
}


def options(model: Path) -> str:
    """Return what is put after `splatcl render MODEL`, but for the size."""
    return VIEWS.get(model.name, VIEW)


def render(model: Path, png: Path) -> None:
    """Render one model as the command line does."""
    status = main(["render", str(model), "--png", str(png), "--size", f"{SIZE}x{SIZE}", *shlex.split(options(model))])
    if status:
        raise SystemExit(f"{model} does not render")


def sheet(folder: Path, output: Path) -> None:
    """Write the contact sheet of all models in `folder`: names above the pictures, options below."""
    models = sorted((p for p in folder.iterdir() if p.is_file() and p.suffix != ".tsv"), key=lambda p: p.name.lower())
    rows, height = -(-len(models) // COLUMNS), SIZE + 2 * LABEL
    picture = Image.new("RGB", (COLUMNS * SIZE, rows * height), "white")
    draw = ImageDraw.Draw(picture)
    with tempfile.TemporaryDirectory() as scratch:
        for i, model in enumerate(models):
            png = Path(scratch) / "model.png"
            render(model, png)
            x, y = i % COLUMNS * SIZE, i // COLUMNS * height
            rendered = Image.open(png)
            picture.paste(rendered, (x, y + LABEL), rendered)
            draw.text((x + 4, y + 2), model.name, fill="black")
            draw.text((x + 4, y + LABEL + SIZE + 2), options(model) or "(no options)", fill="gray")
    picture.save(output, optimize=True)


if __name__ == "__main__":
    sheet(Path(sys.argv[1]), Path(__file__).parent / "contact_sheet.png")
