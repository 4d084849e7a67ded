"""Any numbers: Splats, Camera and settings raise a SplatclError, or render without a NaN.

io/test_damaged_files.py mutates the bytes of files.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

import splatcl
from splatcl import Camera, Light, Material, RenderSettings, SplatclError, Splats
from splatcl.errors import InvalidSplatsError

FUZZ = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
ANY = st.floats(width=32)
MODERATE = st.floats(-4, 4, width=32)
HUGE = st.floats(-1e15, 1e15).map(lambda x: float(np.float32(x)))
SCALES = st.sampled_from([MODERATE, HUGE, st.floats(-(2.0**-20), 2.0**-20, width=32)])


def rows(elements, num=3):
    return npst.arrays(np.float32, (num, 3), elements=elements)


@st.composite
def any_splats(draw, further=()):
    """Return splats with one magnitude of the centers and one of the tangents, or None if they are refused.

    `further` names their extras: clip, field, gloss, attribute.
    """
    center, tangents = draw(rows(draw(SCALES))), draw(SCALES)
    parts, scale = {}, draw(SCALES)
    if "clip" in further:
        parts["clip"] = draw(npst.arrays(np.float32, (3, 2, 3), elements=scale))
    if "field" in further:
        parts["normal_du"], parts["normal_dv"] = draw(rows(scale)), draw(rows(scale))
    names = (("specular", "shininess") if "gloss" in further else ()) + (("height",) if "attribute" in further else ())
    values = draw(rows(MODERATE if "gloss" in further else scale))
    parts["attributes"] = {name: values[:, k] for k, name in enumerate(names)}
    try:
        return Splats(center, draw(rows(tangents)), draw(rows(tangents)), np.abs(draw(rows(MODERATE))), **parts)
    except SplatclError:
        return None


ANY_SIZE = st.tuples(st.integers(1, 40), st.integers(1, 40))
FEW_SIZES = st.sampled_from([(1, 1), (1, 33), (40, 31)])
"""Few image sizes, because each compiles the kernels of single pixels anew."""


@st.composite
def any_camera(draw, sizes):
    eye, target = draw(npst.arrays(np.float64, 3, elements=MODERATE)), draw(rows(MODERATE, 1))[0]
    near = draw(st.floats(1e-6, 10))
    width, height = draw(sizes)
    try:
        return Camera.look_at(
            eye,
            target,
            draw(npst.arrays(np.float64, 3, elements=MODERATE)),
            draw(st.floats(1e-3, 179.9)),
            width,
            height,
            near=near,
            far=near + draw(st.floats(1e-3, 1e6)),
            projection=draw(st.sampled_from(["perspective", "orthographic"])),
        )
    except SplatclError:
        return None


TABLES = st.lists(st.floats(0, 10), min_size=2, max_size=9).map(tuple)
LIGHTS = st.lists(
    st.builds(
        Light,
        kind=st.sampled_from(["headlight", "point"]),
        vector=st.tuples(MODERATE, MODERATE, MODERATE),
        color=st.tuples(*[st.floats(0, 10)] * 3),
    ),
    max_size=3,
).map(tuple)
COMBINATIONS = (  # settings and the splats' extras; few, because each compiles programs
    ({"prefilter": "min"}, ()),
    ({"prefilter": "min", "facing": "flip", "precision": "double"}, ()),
    ({"prefilter": "none", "facing": "cull"}, ()),
    ({"prefilter": "none", "facing": "cull", "target": "float16", "half_inputs": True}, ()),
    ({"method": "zwicker04", "facing": "cull"}, ("clip",)),
    ({"method": "zwicker01"}, ()),
    ({"method": "botsch04", "facing": "cull"}, ("clip", "field", "gloss", "attribute")),
    ({"method": "botsch03", "facing": "cull", "precision": "double", "target": "unorm8"}, ("attribute",)),
)
FEW_COMBINATIONS = (*COMBINATIONS[:3], COMBINATIONS[6])
"""Three combinations whose programs other tests build too, and one with all extras."""


@st.composite
def any_settings(draw, combination):
    """Return settings that include those of a combination, or None if they are refused."""
    try:
        return RenderSettings(
            epsilon=draw(st.one_of(st.just("auto"), st.floats(0, 1e6))),
            along=draw(st.sampled_from(["z", "ray"])),
            prefilter_radius=draw(st.floats(1e-3, 100)),
            prefilter_center=draw(st.sampled_from(["projected", "bounds"])),
            cutoff=draw(st.floats(0, 8)),
            shader="phong" if "method" in combination else draw(st.sampled_from(["phong", "albedo", "normal"])),
            lights=draw(LIGHTS),
            material=Material(shininess=draw(st.floats(0, 1e4))),
            **combination,
        )
    except SplatclError:
        return None


@st.composite
def any_frame(draw, combinations, sizes):
    """Return splats, a camera and settings of one combination, each None if refused."""
    combination, further = draw(st.sampled_from(combinations))
    return draw(any_splats(further)), draw(any_camera(sizes)), draw(any_settings(combination))


def check(frame, camera, choices):
    """Assert the properties of every frame."""
    shape = (camera.height, camera.width)
    for name in frame:
        assert frame[name].shape[:2] == shape
        assert not np.isnan(frame[name]).any(), name
    z, weight, count = frame["Z"], frame["weight"], frame["count"]
    hit = np.isfinite(z)
    assert ((z[hit] >= camera.near * (1 - 1e-6)) & (z[hit] <= camera.far * (1 + 1e-6))).all()
    assert np.array_equal(hit, frame["particleid"] != 0xFFFFFFFF)
    assert not (weight[count == 0] > 0).any()
    if choices.target == "auto":  # the other targets round small weights to 0
        assert (weight[count > 0] > 0).all()
    assert (count[hit] > 0).all()
    assert np.array_equal(frame.color[..., 3], (weight > 0).astype(frame.color.dtype))
    length = np.linalg.norm(frame["N"], axis=-1)
    assert (np.isclose(length, 1, atol=1e-5) | (length == 0)).all()


@FUZZ
@given(frame=any_frame(FEW_COMBINATIONS, FEW_SIZES))
def test_whatever_is_accepted_renders(renderer, frame):
    """Mutations: the mean depth divided by a weight sum of 0; a normal sum of length 0 normalized."""
    check_if_accepted(renderer, *frame)


@pytest.mark.slow
@FUZZ
@given(frame=any_frame(COMBINATIONS, ANY_SIZE))
def test_whatever_is_accepted_renders_in_any_size(renderer, frame):
    check_if_accepted(renderer, *frame)


def check_if_accepted(renderer, splats, camera, choices):
    assume(splats is not None and camera is not None and choices is not None)
    try:
        frame = renderer.render(splats, camera, choices)
    except InvalidSplatsError:  # circles and halves of the largest splats may be too large
        assert choices.circular or choices.half_inputs
        assert max(splats.radius.max(), np.abs(splats.bounds).max()) > 5e14
        return
    check(frame, camera, choices)


@FUZZ
@given(arrays=st.tuples(*[npst.arrays(np.float32, st.tuples(st.integers(0, 4), st.integers(2, 4)), elements=ANY)] * 4))
def test_splats_are_valid_or_refused(arrays):
    try:
        splats = Splats(*arrays)
    except SplatclError as error:
        assert "\n" not in str(error)
        return
    assert len(splats) == len(arrays[0])
    for array in (splats.center, splats.tangent_u, splats.tangent_v, splats.color, splats.normal, splats.bounds):
        assert np.isfinite(array).all()


@FUZZ
@given(
    matrix=npst.arrays(np.float64, (4, 4), elements=st.floats()),
    numbers=st.lists(
        st.one_of(st.floats(), st.integers(-5, 100000), st.text(max_size=3), st.none()), min_size=8, max_size=8
    ),
)
def test_cameras_are_valid_or_refused(matrix, numbers):
    for pose in (matrix, np.eye(4)):
        try:
            camera = Camera(pose, *numbers)
        except SplatclError as error:
            assert "\n" not in str(error)
            continue
        assert np.isfinite(camera.position).all() and camera.near < camera.far


@FUZZ
@given(
    name=st.sampled_from(sorted(RenderSettings.__dataclass_fields__)),
    value=st.one_of(st.floats(), st.text(max_size=5), st.none(), st.lists(st.floats(), max_size=3), st.booleans()),
)
def test_settings_are_valid_or_refused(name, value):
    try:
        RenderSettings(**{name: value})
    except SplatclError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("kernel", [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
def test_tables_with_zeros_render(renderer, kernel):
    splats = Splats(np.zeros((1, 3)), np.eye(3)[:1], np.eye(3)[1:2])
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), width=20, height=20)
    frame = renderer.render(splats, camera, RenderSettings(kernel="table", kernel_table=kernel))
    assert not any(np.isnan(frame[name]).any() for name in frame)
    assert frame["count"].max() == 1 and splatcl is not None
