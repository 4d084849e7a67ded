"""Render a file of points or splats to a PNG with the OpenGL backend: python render.py SCAN -o out.png."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from backend import Backend

import splatcl
from splatcl.io.png import write_png


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scan", help="file of a format that splatcl reads")
    parser.add_argument("-o", "--output", default="out.png")
    parser.add_argument("--size", default="512x512", help="WIDTHxHEIGHT")
    parser.add_argument("--azimuth", type=float, default=0.0, help="degrees")
    parser.add_argument("--elevation", type=float, default=0.0, help="degrees")
    parser.add_argument("--facing", choices=("keep", "flip", "cull"), default="keep")
    parser.add_argument("--shader", choices=("phong", "albedo", "normal"), default="phong")
    options = parser.parse_args(arguments)

    width, height = map(int, options.size.split("x"))
    splats = splatcl.read(options.scan)
    view = {"azimuth": options.azimuth, "elevation": options.elevation, "width": width, "height": height}
    camera = splatcl.Camera.framing(splats.without_outliers().bounding_sphere, **view)
    backend = Backend(splats)
    backend.draw(camera, splatcl.RenderSettings(facing=options.facing, shader=options.shader))
    write_png(options.output, backend.read()["color"])
    print(f"{options.output}: {len(splats)} splats on {backend.renderer_name}")


if __name__ == "__main__":
    main()
