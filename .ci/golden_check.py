"""Check the golden images on one runtime, and write the table of several runtimes. .ci/runtimes calls both.

``check FILE [--tiny]`` renders every scene, or only the tiny ones, in several ways of working. It writes FILE as JSON
and exits 1 if a hash differs. ``seed NAME`` renders one scene with a deliberate error in the kernels, which Oclgrind
must report; it always exits 0. ``table PAGE FILE ...`` prints Markdown and writes it to the end of PAGE, unless that is
empty. It exits 1 if a hash differs between the runtimes.
"""

from __future__ import annotations

import json
import sys
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
SEEDED = {  # by the report that Oclgrind must give: correct kernel text and its faulty replacement
    "Invalid write": ("if (x >= width || y >= height) continue;", "if (x >= width || y > height) continue;"),
    "Invalid read": ("splats + ids[entry[lane]]", "splats + ids[entry[lane] + 4096]"),
    "data race": ("count[q] = ", "count[0] = "),
    "Uninitialized value": ("f.particleid[p] = NO_SPLAT;", ";"),
}


def main(command: str, *arguments: str) -> int:
    """Run a command and return the exit status."""
    bin_pass.MIN_CHUNK = bin_pass.PLANE_PAD  # so that even these few splats fill several chunks
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
    """Keep every buffer alive.

    Oclgrind 21.10 numbers buffers. Where a smaller buffer of the same number was freed, it reports the new one as
    uninitialized past the end of the old one.
    """
    real, kept = pyopencl.Buffer, []

    def buffer(*args: Any, **kwargs: Any) -> Any:
        kept.append(real(*args, **kwargs))
        return kept[-1]

    pyopencl.Buffer = buffer


def check(file: Path, ways: tuple[dict[str, Any], ...], tiny: bool) -> int:
    """Check the hashes in every way of working; write those of the first way, and the device, to `file`."""
    failures, done = 0, []
    for way in ways:
        lanes = way.get("lanes", 1)
        if lanes > 8 and "rusticl" in choose_device().platform.lower():
            print(f"{way}: not tried: rusticl takes more than ten minutes to compile the visibility pass")
            continue
        try:
            renderer = Renderer(**way)
        except DeviceError as error:
            print(f"{way}: not on this runtime: {error}")
            continue
        some = tiny or lanes == 4  # compiling takes a minute for every few scenes
        scenes = [s for s in golden.renderable(renderer) if s.tiny or not some]
        # Further ways render the scenes that share programs; tests/whole/test_golden.py has the rest on PoCL.
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
    }
    file.write_text(json.dumps(result))
    return int(failures > 0)


def explain(renderer: Renderer, name: str) -> int:
    """Run the kernels of `Frame.probe` and `Frame.check` on a scene; return the number of failed checks."""
    scene = next(s for s in golden.scenes() if s.name == name)
    frame = renderer.render(scene.splats, scene.camera, scene.settings)
    frame.probe(frame.width // 2, frame.height // 2)
    failed = [one for one in frame.check() if not one.passed]
    print(*failed, sep="\n")
    return len(failed)


def seed(error: str) -> int:
    """Render a scene with `error` in the kernels."""
    real, (good, bad) = program.inline_source, SEEDED[error]
    program.inline_source = lambda *a: real(*a).replace(good, bad)
    scene = next(s for s in golden.scenes() if s.tiny)
    golden.digest(Renderer(tile_size=8).render(scene.splats, scene.camera, scene.settings))
    return 0


def table(files: list[Path]) -> tuple[str, int]:
    """Return the two Markdown tables, of runtimes and of hashes, and the number of scenes that differ."""
    runtimes = {file.stem: json.loads(file.read_text()) for file in files}
    rows = [["runtime", "version", "ways of working", "scenes"], ["---"] * 4]
    for name, result in runtimes.items():
        rows.append([name, result["version"], len(result["ways"]), len(result["hashes"])])
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
