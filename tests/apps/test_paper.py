"""`splatcl paper`: metrics against closed forms, truths against geometry, tiny experiments, and the page."""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers.paths import ROOT
from tolerances import KERNEL_AREA, MOMENT_RELATIVE

from splatcl.apps.paper import metrics, report, scenes
from splatcl.apps.paper.catalogue import EXPERIMENTS, chosen
from splatcl.apps.paper.experiment import Claim, Figure, Result, Run, verdict
from splatcl.apps.paper.experiments import antialiasing, comparison, filters, perspective, sharp
from splatcl.cli import main
from splatcl.errors import SettingsError

PAGE = ROOT / "docs" / "trust" / "paper.md"
GRAY = np.full((20, 24, 3), 0.5, np.float32)


@pytest.fixture
def run(renderer):
    return Run(renderer, 0.25)


def assert_described(result):
    """Assert that docs/trust/paper.md has an experiment's title, notes, claims and measures."""
    page = PAGE.read_text()
    section = page[page.index(f"\n## {result.name}\n") :]
    assert section.startswith(f"\n## {result.name}\n\n{' '.join([f'{result.title}.', *result.notes])}\n")
    assert all(f"| {claim.says} |" in page for claim in result.claims)
    assert f"| {' | '.join(report.table(result)[0])} |" in section


def test_metrics_of_a_constant_difference():
    brighter = GRAY + np.float32(0.125)
    half = np.zeros((20, 24), bool)
    half[:10] = True
    assert metrics.psnr(brighter, GRAY) == pytest.approx(-20 * np.log10(0.125))
    assert metrics.psnr(np.where(half[..., None], GRAY, brighter), GRAY, half) == np.inf
    assert metrics.differences(brighter, GRAY, half) == (0.125, 0.125)
    c = (0.01 * metrics.PEAK) ** 2  # without variance, only the luminance term of SSIM remains
    expected = (2 * 0.5 * 0.625 + c) / (0.5**2 + 0.625**2 + c)
    assert metrics.ssim(brighter, GRAY) == pytest.approx(expected)
    assert metrics.ssim(GRAY, GRAY) == 1


def test_flip_is_0_for_equal_images_and_more_for_others():
    same = metrics.flip(GRAY, GRAY)
    if same is None:
        pytest.skip(metrics.NO_FLIP)
    assert same == 0
    assert 0.1 < metrics.flip(0 * GRAY, GRAY) <= 1


def test_numbers_of_images():
    image = np.arange(24.0).reshape(4, 6)
    np.testing.assert_array_equal(metrics.box_filtered(image, 2), [[3.5, 5.5, 7.5], [15.5, 17.5, 19.5]])
    assert metrics.num_levels(np.array([[1, 2], [2, 1]])) == 2
    turned = np.array([[0, 0, 1.0], [0, 1, 0], [0, 0, -1]])
    np.testing.assert_allclose(metrics.angles(np.array([[0, 0, 1.0]] * 3), turned), [0, 90, 180])


def test_second_moments_of_a_gaussian():
    y, x = np.indices((65, 65)) - [[[30.0]], [[33.0]]]
    deviation = np.array([[16.0, 5.0], [5.0, 9.0]])
    precision = np.linalg.inv(deviation)
    power = precision[0, 0] * x * x + 2 * precision[0, 1] * x * y + precision[1, 1] * y * y
    np.testing.assert_allclose(metrics.second_moments(np.exp(-power / 2)), deviation, rtol=MOMENT_RELATIVE)


def test_the_checkerboards_truth_is_the_square_at_the_pixels_center():
    camera = scenes.checkerboard_camera(96, 72)
    truth = scenes.checkerboard_truth(camera, 2)
    x, z = (axis.ravel() for axis in np.meshgrid(np.arange(-0.6, 0.7, 0.4), np.arange(-4.6, -3, 0.4)))
    raster, _ = camera.project(np.stack([x, 0 * x, z], axis=1))
    column, row = np.floor(raster).astype(int).T
    np.testing.assert_allclose(truth[row, column], scenes.checker_color(x, z))
    assert len(np.unique(truth[row, column], axis=0)) == 2


def test_pixels_toward_the_horizon_are_longer_than_squares():
    camera = scenes.checkerboard_camera(96, 72)
    far = scenes.undersampled(camera)
    origin, direction = scenes.rays(camera)
    z = -origin[1] / direction[..., 1] * direction[..., 2]
    length = -np.diff(z, axis=0)[..., 0]
    last = np.count_nonzero(far[:, 0])
    assert far[:last].all() and not far[last:].any()
    assert abs(length[last - 1]) > 2 * scenes.CHECK * 0.9 and abs(length[last]) < 2 * scenes.CHECK * 1.1


def test_spheres_and_phongs_truth():
    camera = scenes.sphere_camera(33, 33)
    normals, view = scenes.sphere_truth(camera)
    np.testing.assert_allclose(normals[16, 16], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normals[10:20, 10:20], axis=-1), 1)
    np.testing.assert_allclose(view[16, 16], [0, 0, -1], atol=1e-12)
    material = comparison.MATERIAL
    assert comparison.phong_truth(np.array(1.0)) == 0.6 * (material.ambient + material.diffuse) + material.specular


def test_kernels_have_the_areas_of_closed_form(run):
    y, x = (np.indices((801, 801)) - 400.0) / 200
    for ratio in (0.25, 0.8, 1.0):
        a, b = filters.ASPECT * ratio, ratio
        union = np.count_nonzero(((x / a) ** 2 + (y / b) ** 2 <= 1) | (x * x + y * y <= 1)) / 200**2
        expected = np.pi * np.sqrt((a * a + 1) * (b * b + 1)) / union
        assert filters.expected(ratio) == pytest.approx(expected, rel=2e-3)
    result = filters.kernels(run)
    areas, expected = (
        [figure.value for figure in result.figures if figure.measure == name]
        for name in ("area EWA / min", "in closed form")
    )
    np.testing.assert_allclose(areas, expected, rtol=KERNEL_AREA)
    assert all(claim.verdict == "holds" for claim in result.claims)
    assert_described(result)


def test_only_affine_outlines_leave_holes(run):
    floor, camera = scenes.touching_floor(), scenes.low_camera(64, 48)
    share = {
        name: perspective.hole_share(
            run.render(floor, camera, **perspective.BARE, **perspective.OUTLINES[name]).color, scenes.on_floor(camera)
        )
        for name in ("affine", "conic")
    }
    assert share["affine"] > 1 and share["conic"] == 0


@pytest.mark.slow
def test_outlines_at_extreme_perspective(run):
    result = perspective.holes(run)
    share = {figure.of: figure.value for figure in result.figures if figure.measure == "uncovered floor"}
    assert share["affine"] > 1 and share["conic"] == share["ray cast"] == 0
    wrong = {figure.of: figure.value for figure in result.figures if figure.measure == "wrong pixels of one disc"}
    assert wrong["affine"] > 20 and wrong["conic"] < 1 and wrong["ray cast"] < 1
    assert [claim.verdict for claim in result.claims] == ["holds", "holds", "does not hold", "holds"]
    assert_described(result)


def test_the_screen_space_filter_removes_aliasing(run):
    result = antialiasing.screen_filter(run)
    assert [claim.verdict for claim in result.claims] == ["holds"]
    assert result.figures[0].value < 2 < 20 < result.figures[1].value
    assert_described(result)


@pytest.mark.slow
def test_sharp_features_need_their_clip_lines(run):
    result = sharp.sharp_features(run)
    assert [claim.verdict for claim in result.claims] == ["holds", "holds"]
    assert_described(result)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["targets", "checkerboards", "shaders", "overdraw", "half_inputs", "comparison"])
def test_the_page_describes_what_experiments_measure(renderer, name):
    assert_described(EXPERIMENTS[name](Run(renderer, 0.125)))


RESULT = Result(
    "stub",
    "A title",
    (Figure("a", "error", 0.25, "dB"), Figure("a", "number", 1234567.0), Figure("b", "error", 12.5, "%")),
    (Claim("One.", "1.", "holds"), Claim("Two.", "2.", "does not hold")),
    {"small one": np.zeros((16, 20)), "larger": np.full((24, 16, 4), 0.5)},
    ("a note",),
)


def test_the_verdict_on_a_whole_claim_and_on_a_part():
    assert [verdict(*case) for case in ((True,), (False, True), (False,))] == [
        "holds",
        "holds in part",
        "does not hold",
    ]


@pytest.mark.parametrize(
    ("quality", "error", "comparable", "removes"),
    [
        (21.0, 9.9, "holds in part", "does not hold"),
        (21.0, 3.1, "holds", "holds"),
        (21.0, 14.0, "does not hold", "does not hold"),
        (20.0, 3.1, "does not hold", "holds"),
    ],
)
def test_the_verdicts_on_the_min_filter(quality, error, comparable, removes):
    others = {"none": (19.3, 27.7), "2x2": (22.5, 10.5), "3x3": (22.8, 8.5), "EWA": (18.3, 0.6), "EWA/2": (21.5, 1.6)}
    measured = {**others, "min": (quality, error)}
    claims = antialiasing._claims(*({name: pair[i] for name, pair in measured.items()} for i in (0, 1)))
    verdicts = {claim.says: claim.verdict for claim in claims}
    assert verdicts["The min filter's quality is comparable to EWA's."] == comparable
    assert verdicts["The min filter removes the aliasing that supersampling by 3x3 leaves."] == removes


def test_a_result_as_a_folder_and_as_a_page(tmp_path, capsys):
    report.print_result(RESULT)
    printed = capsys.readouterr().out
    assert "0.25 dB" in printed and "1,234,567" in printed and "does not hold: Two. 2." in printed
    report.write_folder(tmp_path / "out", [RESULT])
    report.write_docs(tmp_path / "docs", [RESULT])
    files = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*")}
    index = {"out/index.md", "out/stub_small_one.png", "out/stub_larger.png"}
    assert files == index | {"docs/trust/paper.md", "docs/images/paper_stub.png"}
    for path in (tmp_path / "out/index.md", tmp_path / "docs/trust/paper.md"):
        text = path.read_text()
        assert "| a | 0.25 dB | 1,234,567 |" in text and "| b | 12.5% |  |" in text and "a note" in text
        assert "| [stub](#stub) | Two. | 2. | does not hold |" in text
    assert report.strip([report.picture(image) for image in RESULT.images.values()]).shape == (24, 44, 4)


def test_the_page_names_every_experiment():
    text = PAGE.read_text()
    table = text[: text.index("\n## ")]
    assert text.startswith(report.INTRODUCTION)
    assert re.findall(r"^## (\w+)$", text, re.MULTILINE) == list(EXPERIMENTS)
    assert all(f"[{name}](#{name})" in table for name in EXPERIMENTS)
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
    assert pictures and all((PAGE.parent / picture).exists() for picture in pictures)


def test_names_that_are_no_experiments(capsys):
    assert [experiment.__name__ for experiment in chosen(["holes", "targets"])] == ["holes", "targets"]
    with pytest.raises(SettingsError, match="no experiment 'hole'; there are targets, "):
        chosen(["hole"])
    assert main(["paper", "hole"]) == 2
    assert main(["paper", "holes", "--docs", "docs"]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 2 and "--docs needs all experiments; leave out their names" in errors[1]
