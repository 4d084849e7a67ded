"""Updates of uploaded splats: the bits of a fresh upload, the device's buffers, and the mistakes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import scenes
from helpers.bits import assert_same_bits

from splatcl import Camera, RenderSettings
from splatcl.errors import InvalidSplatsError

SIZE = 48
CAMERA = Camera.look_at((0.0, 0.0, -3.0), (0.0, 0.0, 0.0), width=SIZE, height=SIZE)
SETTINGS = RenderSettings(precision="single")
OPTIONS = {
    "plain": {},
    "double": {"precision": "double"},
    "half": {"half_inputs": True},
    "circular": {"circular": True},
    "both": {"half_inputs": True, "circular": True, "normals": "field"},
}
ARRAYS = ("center", "tangent_u", "tangent_v", "color", "normal_du", "normal_dv", "clip", "heat", "specular")


def splats():
    named = ("heat", "specular", *(f"a{k}" for k in range(7)))
    return scenes.extended("sphere", clip=True, field=True, attributes=named)


def changes(given, name, seed=1):
    """Return the arguments that replace the array `name` of splats."""
    rng = np.random.default_rng(seed)
    old = given.attributes[name] if name in given.attributes else getattr(given, name)
    new = (old * (1 + 0.1 * rng.random(old.shape))).astype(old.dtype)
    return {"attributes": {name: new}} if name in given.attributes else {name: new}


def changed(given, arrays):
    named = {"attributes": {**given.attributes, **arrays["attributes"]}} if "attributes" in arrays else {}
    return replace(given, **arrays | named, on_invalid="error")


def buffers(uploaded, settings):
    (held,) = uploaded.prepared(settings)._on_device.values()
    return [held.center, held.tangent_u, held.tangent_v, held.splats, held.extra] + [
        group.values for group in held.attribute_groups
    ]


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("options", OPTIONS)
def test_an_update_has_the_bits_of_a_fresh_upload(renderer, options, name):
    settings, given = replace(SETTINGS, **OPTIONS[options]), splats()
    arrays = changes(given, name)
    uploaded = renderer.upload(given)
    before = renderer.render(uploaded, CAMERA, settings)
    held = buffers(uploaded, settings)
    moved = renderer.update(uploaded, **arrays)
    after = renderer.render(moved, CAMERA, settings)
    assert_same_bits(after, renderer.render(changed(given, arrays), CAMERA, settings))
    assert_same_bits(before, renderer.render(given, CAMERA, settings))  # read only now
    assert all(a is b for a, b in zip(held, buffers(moved, settings), strict=True))


def test_the_earlier_object_stays_valid(renderer):
    given = splats()
    uploaded = renderer.upload(given)
    frame = renderer.render(uploaded, CAMERA, SETTINGS)
    moved = renderer.update(uploaded, **changes(given, "center"))
    late = renderer.render(moved, CAMERA, SETTINGS)
    assert_same_bits(renderer.render(uploaded, CAMERA, SETTINGS), frame)
    assert_same_bits(renderer.render(moved, CAMERA, SETTINGS), late)
    np.testing.assert_array_equal(frame["margin"], renderer.render(given, CAMERA, SETTINGS)["margin"])


def test_updates_without_a_frame_between_add_up(renderer):
    given = splats()
    moved = renderer.upload(given)
    for options in OPTIONS.values():
        renderer.render(moved, CAMERA, replace(SETTINGS, **options))
    for k, name in enumerate(ARRAYS):
        arrays = changes(given, name, seed=k)
        given, moved = changed(given, arrays), renderer.update(moved, **arrays)
    for options in OPTIONS.values():
        settings = replace(SETTINGS, **options)
        assert_same_bits(renderer.render(moved, CAMERA, settings), renderer.render(given, CAMERA, settings))
    assert moved.auto_epsilon == renderer.upload(given).auto_epsilon


def test_a_low_word_and_an_origin_appear_and_vanish(renderer):
    given = splats()
    moved = renderer.upload(given)
    far = given.center.astype(np.float64) + np.array([4e5, 5e6, 100.1])
    for center, eye in ((given.center, np.zeros(3)), (far, np.array([4e5, 5e6, 100.0])), (given.center, np.zeros(3))):
        camera = Camera.look_at(eye - (0, 0, 3), eye, width=SIZE, height=SIZE)
        moved = renderer.update(moved, center=center)
        want = renderer.render(replace(given, center=center), camera, SETTINGS)
        assert want["count"].any()
        assert_same_bits(renderer.render(moved, camera, SETTINGS), want)


def test_optional_arrays_may_be_added(renderer):
    plain, rich = scenes.sphere(), splats()
    moved = renderer.upload(plain)
    renderer.render(moved, CAMERA, SETTINGS)
    for arrays in ({"clip": rich.clip}, {"attributes": dict(rich.attributes)}):
        plain, moved = replace(plain, **arrays), renderer.update(moved, **arrays)
        assert_same_bits(renderer.render(moved, CAMERA, SETTINGS), renderer.render(plain, CAMERA, SETTINGS))


def test_an_update_of_nothing_is_the_same_object(renderer):
    uploaded = renderer.upload(splats())
    assert renderer.update(uploaded) is uploaded


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"center": np.zeros((3, 3))}, r"cannot update 400 splats: center has 3 rows; upload them anew"),
        ({"color": 1.0}, r"cannot update 400 splats: color has 1 rows; upload them anew"),
        ({"attributes": {"heat": np.zeros(4)}}, r"cannot update 400 splats: heat has 4 rows; upload them anew"),
        ({"center": np.zeros((400, 2))}, r"center has shape \(400, 2\); it must be \(N, 3\)"),
        ({"color": ["red"] * 400}, r"color must be an array of numbers .*"),
        ({"attributes": {"Heat": np.zeros(400)}}, r"attribute 'Heat' must be named with lower-case letters.*"),
        (
            {"tangent_u": np.zeros((400, 3))},
            r"cannot update: 400 of 400 splats \(400 with an area .* the first is splat 0\); correct the arrays",
        ),
    ],
)
def test_mistakes_are_told_in_one_line(renderer, arrays, message):
    uploaded = renderer.upload(splats())
    with pytest.raises(InvalidSplatsError, match=f"^{message}$"):
        renderer.update(uploaded, **arrays)


def test_only_the_changed_arrays_travel(renderer, monkeypatch):
    given, sizes = splats(), []
    uploaded = renderer.upload(given)
    renderer.render(uploaded, CAMERA, SETTINGS)
    write = type(renderer.device).write
    monkeypatch.setattr(
        type(renderer.device),
        "write",
        lambda self, buffer, array: (sizes.append(array.nbytes), write(self, buffer, array)),
    )
    moved = renderer.update(uploaded, color=given.color)
    renderer.render(moved, CAMERA, SETTINGS)
    assert sizes.count(given.color.nbytes) == 1 and not [size for size in sizes if size > given.color.nbytes]
