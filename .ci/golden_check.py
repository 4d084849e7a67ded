"""The golden images on one runtime, and the table of several runtimes; .ci/runtimes calls both.

``check FILE [--tiny]`` renders every scene (the tiny ones) in several ways of working, writes FILE as JSON and
exits 1 where a hash differs. ``seed NAME`` renders under kernels with one error put in on purpose, which Oclgrind
must report: it exits 0 either way. ``table PAGE FILE ...`` prints Markdown, puts it at the end of PAGE (if that is
not empty) and exits 1 where a hash differs.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import pyopencl

from splatcl import Renderer
from splatcl.errors import DeviceError
from splatcl.evidence.golden import check as golden
from splatcl.opencl.device import program
from splatcl.opencl.device.devices import choose_device
from splatcl.opencl.passes import bin as bin_pass

WAYS: tuple[dict[str, Any], ...] = (
    {},
    {"mapping": "pixel", "tile_size": 8},
    {"lanes": 4, "tile_size": 32},
    {"lanes": 16},
)
TINY_WAYS: tuple[dict[str, Any], ...] = ({"tile_size": 8}, {"mapping": "pixel", "tile_size": 8}, {"lanes": 1})
MEASURED = "<!-- .ci/runtimes writes the rest -->\n\n"
SEEDED = {  # what Oclgrind must report: the kernels' text, and the error in its place
    "Invalid write": ("if (x >= width || y >= height) continue;", "if (x >= width || y > height) continue;"),
    "Invalid read": ("splats + ids[entry[lane]]", "splats + ids[entry[lane] + 4096]"),
    "data race": ("count[q] = ", "count[0] = "),
    "Uninitialized value": ("f.particleid[p] = NO_SPLAT;", ";"),
}


def main(command: str, *arguments: str) -> int:
    """Run a command; return the exit status."""
    bin_pass.MIN_CHUNK = bin_pass.PLANE_PAD  # several chunks of the few splats
    if command == "seed" or "--tiny" in arguments:
        keep_buffers()
    if command == "check":
        return check(Path(arguments[0]), TINY_WAYS if "--tiny" in arguments else WAYS, "--tiny" in arguments)
    if command == "seed":
        return seed(*arguments)
    text, failures = table([Path(file) for file in arguments[1:]])
    print(text)
    if arguments[0]:
        page = Path(arguments[0])
        page.write_text(page.read_text().partition(MEASURED)[0] + MEASURED + text)
    return int(failures > 0)


def keep_buffers() -> None:
    """Free no buffer: Oclgrind 21.10 takes a new one for uninitialised past the end of a freed one of its number."""
    real, kept = pyopencl.Buffer, []

    def buffer(*args: Any, **kwargs: Any) -> Any:
        kept.append(real(*args, **kwargs))
        return kept[-1]

    pyopencl.Buffer = buffer


def check(file: Path, ways: tuple[dict[str, Any], ...], tiny: bool) -> int:
    """Check the hashes in every way of working; write those of the first, the device and the time."""
    start, failures, done = time.monotonic(), 0, []
    for way in ways:
        lanes = way.get("lanes", 1)
        if lanes > 8 and "rusticl" in choose_device().platform.lower():
            print(f"{way}: not tried: rusticl compiles the visibility pass for more than ten minutes")
            continue
        try:
            renderer = Renderer(**way)
        except DeviceError as error:
            print(f"{way}: not on this runtime: {error}")
            continue
        some = tiny or lanes == 4  # a minute to compile for each few scenes
        scenes = [s for s in golden.renderable(renderer) if s.tiny or not some]
        # In further ways those whose programs many scenes share; tests/test_golden.py takes others on PoCL.
        names = [s.name for s in scenes if s.plain or way == ways[0]]
        mismatches = golden.check(renderer, names)
        print(*mismatches, f"{way}: {len(names)} scenes, {len(mismatches)} AOVs differ", sep="\n", flush=True)
        failures += len(mismatches) + explain(renderer, names[0])
        done.append(way)
    renderer, info = Renderer(**ways[0]), choose_device()
    result = {
        "version": f"{info.version.strip()}; {info.name}, driver {info.handle.driver_version}",
        "ways": done,
        "hashes": {
            s.name: golden.one_hash(golden.digest(renderer.render(s.splats, s.camera, s.settings)))
            for s in golden.renderable(renderer)
            if s.tiny or not tiny
        },
        "seconds": time.monotonic() - start,
    }
    file.write_text(json.dumps(result))
    return int(failures > 0)


def explain(renderer: Renderer, name: str) -> int:
    """Probe the middle pixel of a scene and account for all of it: the other kernels run too. Return the failures."""
    scene = next(s for s in golden.scenes() if s.name == name)
    frame = renderer.render(scene.splats, scene.camera, scene.settings)
    frame.probe(frame.width // 2, frame.height // 2)
    failed = [one for one in frame.check() if not one.passed]
    print(*failed, sep="\n")
    return len(failed)


def seed(error: str) -> int:
    """Render a scene under kernels with `error` in them."""
    real, (good, bad) = program.inline_source, SEEDED[error]
    program.inline_source = lambda *a: real(*a).replace(good, bad)
    scene = next(s for s in golden.scenes() if s.tiny)
    golden.digest(Renderer(tile_size=8).render(scene.splats, scene.camera, scene.settings))
    return 0


def table(files: list[Path]) -> tuple[str, int]:
    """Return the devices, and scene by runtime the first digits of each hash; and how many scenes differ."""
    runtimes = {file.stem: json.loads(file.read_text()) for file in files}
    rows = [["runtime", "version", "ways of working", "scenes", "seconds"], ["---"] * 5]
    for name, result in runtimes.items():
        rows.append([name, result["version"], len(result["ways"]), len(result["hashes"]), round(result["seconds"])])
    rows += [[], ["scene", *runtimes], ["---"] * (1 + len(runtimes))]
    failures = 0
    for scene in golden.scenes():
        hashes = [result["hashes"].get(scene.name, "-") for result in runtimes.values()]
        rows.append([scene.name, *(h[:8] for h in hashes)])
        failures += len(set(hashes) - {"-"}) > 1
    lines = [f"| {' | '.join(map(str, row))} |" if row else "" for row in rows]
    return "\n".join([*lines, "", f"{len(golden.scenes())} scenes, {failures} of them different.", ""]), failures


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
