"""Compare the AOVs of the golden images with the hashes in golden.json.

`python -m splatcl.evidence.golden.check` (`make golden`) writes golden.json again. docs/trust/reproducibility.md has
the results.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splatcl.evidence.golden.scenes import GoldenScene, scenes
from splatcl.opencl.draw import draw
from splatcl.opencl.session import Session

Hashes = dict[str, str]
"""SHA-256 of each AOV of a scene, by the AOV's name."""


def digest(aovs: Mapping[str, NDArray[Any]]) -> Hashes:
    """Return the SHA-256 of each AOV by name, over its shape, dtype and little-endian bytes."""
    hashes = {}
    for name in aovs:
        array = np.ascontiguousarray(aovs[name])
        little = array.astype(array.dtype.newbyteorder("<"), copy=False)
        hashes[name] = hashlib.sha256(f"{array.shape} {little.dtype.str}\n".encode() + little.tobytes()).hexdigest()
    return hashes


def one_hash(hashes: Hashes) -> str:
    """Return the SHA-256 of all hashes of a scene, which docs/trust/reproducibility.md lists."""
    return hashlib.sha256(json.dumps(hashes, sort_keys=True).encode()).hexdigest()


@cache
def stored() -> dict[str, Hashes]:
    """Return the hashes of golden.json, by scene and then by AOV."""
    return json.loads((files("splatcl.evidence.golden") / "golden.json").read_text())


def check(session: Session, names: Iterable[str] | None = None) -> list[str]:
    """Render the scenes and return one line for each AOV whose hash differs from the stored one.

    Parameters
    ----------
    session : Session
        Neither its device nor its tile size, lanes and mapping may change a bit.
    names : iterable of str, optional
        Names of scenes; by default all that the device can render (`renderable`).
    """
    wanted = {s.name for s in renderable(session)} if names is None else set(names)
    mismatches = []
    for scene in scenes():
        if scene.name not in wanted:
            continue
        found = digest(draw(session, scene.splats, scene.camera, scene.settings).aovs)
        expected = stored().get(scene.name, {})
        for aov in sorted(found | expected):
            was, now = (hashes.get(aov, "missing")[:12] for hashes in (expected, found))
            if expected.get(aov) != found.get(aov):
                mismatches.append(f"{scene.name} {aov}: {now}, not {was}")
    return mismatches


def renderable(session: Session) -> list[GoldenScene]:
    """Return the scenes that the session's device can render; some need double precision."""
    return [s for s in scenes() if s.settings.precision == "single" or session.supports_double]


def main() -> None:
    """Write golden.json beside this file, from the default device."""
    session = Session()
    hashes = {s.name: digest(draw(session, s.splats, s.camera, s.settings).aovs) for s in scenes()}
    Path(__file__).with_name("golden.json").write_text(json.dumps(hashes, indent=1) + "\n")


if __name__ == "__main__":
    main()
