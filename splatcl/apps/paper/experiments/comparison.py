"""The methods side by side: holes, shading, aliasing and speed, each measured."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.apps.paper.experiment import Claim, Figure, Result, Run, verdict
from splatcl.apps.paper.experiments.antialiasing import HEIGHT, SHEET, WIDTH, aliasing, truth
from splatcl.apps.paper.experiments.perspective import BARE, hole_share
from splatcl.apps.paper.metrics import angles, psnr
from splatcl.apps.paper.scenes import (
    checkerboard,
    checkerboard_camera,
    low_camera,
    on_floor,
    painted,
    sphere,
    sphere_camera,
    sphere_truth,
    touching_floor,
)
from splatcl.apps.timing import seconds_of, turn_by_turn
from splatcl.scene.lights import Material
from splatcl.scene.settings import METHODS, Method, RenderSettings
from splatcl.scene.splats import Splats

SIZE, COARSE, MANY = 512, 400, 400_000
"""Side of the timed image in pixels, and numbers of splats of the shaded and of the timed sphere."""
FRAMES, MAX_SECONDS = 7, 20.0
INNER = 0.3
"""Least cosine between normal and view at which the sphere is compared. It leaves out the silhouette of the discs."""
MATERIAL = Material(ambient=0.1, diffuse=0.8, specular=0.5, shininess=24)
MEANING = (
    "Holes are those of the near floor of `holes`, without pre-filter. Errors are means over a unit sphere of "
    f"{COARSE} splats, against the sphere itself. PSNR and aliasing are those of `checkerboards`. Speed is that of all "
    "passes of a sphere, with the methods in turn."
)
NAMES: dict[Method, str] = {
    "botsch05": "[BHZK05]",
    "zwicker04": "[ZRB04]",
    "zwicker01": "[ZPvBG01]",
    "botsch04": "[BSK04]",
    "botsch03": "[BK03]",
}


def comparison(run: Run) -> Result:
    """Measure every method on the same scenes."""
    times = _seconds(run)
    figures, measured = [], {}
    for method in METHODS:
        normal, color = shading_errors(run, method)
        quality, alias = _checkerboard(run, method)
        measured[method] = one = {
            "holes": (_holes(run, method), "%"),
            "normal error": (normal, "degrees"),
            "Phong error": (color, "/255"),
            "PSNR": (quality, "dB"),
            "aliasing": (alias, "%"),
            "speed": (run.number(MANY) / times[method] / 1e6, "Msplats/s"),
            "time / botsch05": (times[method] / times["botsch05"], ""),
        }
        row = f"{method} {NAMES[method]}"
        figures += [Figure(row, name, value, unit) for name, (value, unit) in one.items()]
    title = "The methods side by side"
    return Result("comparison", title, tuple(figures), _claims(measured), notes=(MEANING,))


def _claims(measured: dict[Method, Any]) -> tuple[Claim, ...]:
    holes, phong, alias = (
        {method: one[key][0] for method, one in measured.items()} for key in ("holes", "Phong error", "aliasing")
    )
    exact = [method for method, settings in METHODS.items() if settings.get("footprint") != "affine"]
    filtered = [method for method, settings in METHODS.items() if settings.get("prefilter") != "none"]
    others = [method for method in METHODS if method not in filtered]
    better = [measure["botsch05"] < measure["botsch04"] for measure in (alias, phong)]
    return (
        Claim(
            "Ray casting and conics are perspective correct; affine outlines are not.",
            "; ".join(f"{method} {share:.2g}% holes" for method, share in holes.items()) + ".",
            verdict(all((holes[method] == 0) == (method in exact) for method in METHODS)),
        ),
        Claim(
            "Blended normals shade smoothly per pixel, linear normal fields even better; one color per splat does not.",
            "; ".join(f"{method} off by {error:.2g}/255" for method, error in phong.items()) + ".",
            verdict(phong["botsch04"] <= phong["botsch05"] < phong["botsch03"]),
        ),
        Claim(
            "Methods with a screen-space filter are anti-aliased.",
            "; ".join(f"{method} {error:.2g}% aliasing" for method, error in alias.items()) + ".",
            verdict(max(alias[method] for method in filtered) < min(alias[method] for method in others)),
        ),
        Claim(
            "Phong shading and anti-aliasing make botsch05 superior even to botsch04.",
            f"Aliasing is {alias['botsch05']:.2g}% against {alias['botsch04']:.2g}%, the Phong error "
            f"{phong['botsch05']:.2g}/255 against {phong['botsch04']:.2g}/255.",
            verdict(all(better), part=any(better)),
        ),
    )


def _flat(splats: Splats) -> Splats:
    """Return splats whose normal field is constant, for the method that needs one."""
    zero = np.zeros_like(splats.center)
    return replace(splats, normal_du=zero, normal_dv=zero, on_invalid="error")


def _holes(run: Run, method: Method) -> float:
    """Return the uncovered share of the near floor without pre-filter, percent."""
    camera = low_camera(run.pixels(WIDTH), run.pixels(HEIGHT))
    return hole_share(run.render(_flat(touching_floor()), camera, method=method, **BARE).color, on_floor(camera))


def _checkerboard(run: Run, method: Method) -> tuple[float, float]:
    """Return the checkerboard's PSNR, dB, and its aliasing, percent of white."""
    camera = checkerboard_camera(run.pixels(WIDTH), run.pixels(HEIGHT))
    image = run.render(_flat(checkerboard()), camera, method=method, **SHEET).color[..., :3]
    return psnr(image, truth(camera.width, camera.height)), aliasing(image, camera)


def shading_errors(run: Run, method: Method) -> tuple[float, float]:
    """Return the mean errors of a coarse sphere's normals, degrees, and of its Phong colors, /255."""
    camera = sphere_camera(run.pixels(WIDTH), run.pixels(WIDTH))
    normals, view = sphere_truth(camera)
    colored = sphere(COARSE)
    gray = painted(colored, np.full_like(colored.color, 0.6))
    frame = run.render(gray, camera, method=method, material=MATERIAL)
    facing = np.sum(normals * view, axis=-1)
    inner = (facing > INNER) & (frame.color[..., 3] > 0)
    exact = phong_truth(facing[inner])
    return (
        float(angles(frame["N"][inner], normals[inner]).mean()),
        255 * float(np.abs(frame.color[inner][:, 0] - exact).mean()),
    )


def phong_truth(facing: NDArray[Any]) -> NDArray[Any]:
    """Return Phong's color of gray 0.6 under a headlight where the normal's cosine to the eye is `facing`.

    The mirrored light's cosine to the eye is 2 facing^2 - 1.
    """
    mirrored = np.maximum(2 * facing**2 - 1, 0)
    return 0.6 * (MATERIAL.ambient + MATERIAL.diffuse * facing) + MATERIAL.specular * mirrored**MATERIAL.shininess


def _seconds(run: Run) -> dict[Method, float]:
    """Return each method's median time for a frame of a sphere of MANY splats, seconds; the methods take turns."""
    splats = run.renderer.upload(sphere(run.number(MANY)))
    side = run.pixels(SIZE)
    camera = sphere_camera(side, side)

    def draw(method: Method) -> None:
        run.renderer.render(splats, camera, RenderSettings(method=method))
        run.renderer.device.queue.finish()

    def job(method: Method) -> dict[str, float]:
        return {method: seconds_of(partial(draw, method))}

    jobs = {method: partial(job, method) for method in METHODS}
    for method in jobs:
        draw(method)
    spreads = turn_by_turn(list(jobs.values()), FRAMES, MAX_SECONDS, lambda steps: None)
    return {method: one[method].median for method, one in zip(jobs, spreads, strict=True)}
