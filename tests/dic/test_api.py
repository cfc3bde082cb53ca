"""Tests of the public Python functions of `dic`, with right and with wrong arguments."""

import weakref
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import dic
from rig.run import run_protocol
from tests.command_line import run_dic
from tests.places import EXAMPLES, example, small_cameras

# x and y of the image; y points down, so that a shear has the other sign in strains, whose y points up
F = np.array([[1.01, 0.004], [-0.002, 0.9967]])
E = (F.T @ F - np.eye(2)) / 2
TRUE = {"exx": E[0, 0], "eyy": E[1, 1], "exy": -E[0, 1]}
MM_PER_PX = 0.05


def stretched(x, y):
    """Return the place in the reference that is seen at (x, y) after the deformation by F."""
    back = np.linalg.inv(F)
    return back[0, 0] * x + back[0, 1] * y, back[1, 0] * x + back[1, 1] * y


@pytest.fixture(scope="module")
def images(speckle):
    """A reference image, and an image of the pattern deformed by F, without noise."""
    pattern = speckle(seed=31)
    return pattern.draw(), pattern.draw(stretched)


@pytest.fixture(scope="module")
def folder(images, tmp_path_factory):
    """A folder with the images as reference.tif and deformed.tif, in floating point."""
    folder = tmp_path_factory.mktemp("api")
    for name, image in zip(("reference", "deformed"), images, strict=True):
        assert cv2.imwrite(str(folder / f"{name}.tif"), image)
    return folder


@pytest.fixture(scope="module")
def calibration(images):
    """A calibration of an on-axis camera, whose grid covers the whole image."""
    height, width = images[0].shape
    index = np.stack(np.meshgrid(np.arange(9), np.arange(9)), axis=-1).reshape(-1, 2)
    x, y = index[:, 0] * (width - 1) / 8, (8 - index[:, 1]) * (width - 1) / 8
    grid = dic.targets.GridPoints.on_lattice(
        index, np.column_stack([x, y]), (9, 9), (width - 1) / 8 * MM_PER_PX
    )
    return dic.Calibration.fit(grid, (height, width))


def assert_true(mean, within=2e-6):
    assert {name: getattr(mean, name) for name in TRUE} == pytest.approx(TRUE, abs=within)


def test_two_image_files_give_mean_strain_and_a_strain_map_in_six_lines(folder, monkeypatch):
    monkeypatch.chdir(folder)
    code = """
import dic
series = dic.measure_images("reference.tif", ["deformed.tif"])
image = series.images[0]
mean, strain = image.mean, image.strain.exx
dic.write_maps(image.measurement, series.reference, "strain.png")
"""
    found = {}
    exec(code, found)
    assert_true(found["mean"])
    local = found["strain"][np.isfinite(found["strain"])]
    assert local.size > 100
    # 5 mpx at either end of a gauge of 71 px would be 140 µε
    np.testing.assert_allclose(local, TRUE["exx"], atol=1e-4)
    assert cv2.imread("strain.png").shape[2] == 3


def test_arrays_files_and_texts_give_the_same(images, folder):
    reference, deformed = folder / "reference.tif", folder / "deformed.tif"
    ways = [
        dic.measure_images(*images),
        dic.measure_images(images[0].astype(np.float64), iter([deformed])),
        dic.measure_images(str(reference), str(deformed)),
        dic.measure_images(reference, dic.pipeline.SeriesImage(images[1], "own name")),
    ]
    for series in ways:
        np.testing.assert_array_equal(series.reference, images[0])
        np.testing.assert_array_equal(series.measurements[0].field.warps, ways[0].measurements[0].field.warps)
    labels = [series.images[0].label for series in ways]
    assert labels == ["image 1", str(deformed), str(deformed), "own name"]


def test_the_steps_by_hand_are_those_of_a_series(images, calibration):
    settings = dic.CorrelationSettings(subset_px=21, step_px=5)
    series = dic.measure_images(*images, settings=settings, calibration=calibration)
    field = dic.Correlator(images[0], settings=settings).correlate(images[1])
    measurement = dic.measure(field, calibration)
    assert measurement.mean == series.images[0].mean
    assert_true(measurement.calibrated_mean)
    assert measurement.mean is measurement.calibrated_mean
    rows, columns = np.nonzero(field.converged)
    x, y = field.x_px[columns], field.y_px[rows]
    u, v = (F - np.eye(2)) @ [x, y]
    found = measurement.calibrated.vector[rows, columns] / MM_PER_PX
    np.testing.assert_allclose(found, np.column_stack([u, -v]), atol=5e-3)


def test_a_gauge_is_that_of_the_settings_the_field_was_correlated_with(images, calibration):
    settings = dic.CorrelationSettings(subset_px=21, step_px=5)
    field = dic.Correlator(images[0], settings=settings).correlate(images[1])
    measurement = dic.measure(field, calibration, dic.StrainSettings(window_points=3))
    assert measurement.settings == settings
    assert measurement.gauge_px == 2 * 5 + 21
    assert measurement.gauge_mm == pytest.approx(31 * MM_PER_PX, rel=1e-9)


def test_a_region_may_be_an_array_or_a_mask_image(images, folder):
    mask = np.zeros(images[0].shape, bool)
    mask[40:120, 50:140] = True
    cv2.imwrite(str(folder / "mask.png"), np.where(mask, 255, 0).astype(np.uint8))
    of_array, of_file = (
        dic.measure_images(*images, region=region).measurements[0] for region in (mask, folder / "mask.png")
    )
    np.testing.assert_array_equal(of_array.field.active, of_file.field.active)
    assert of_array.field.x_px.min() >= 50
    assert of_array.field.x_px.max() < 140


def test_a_calibration_file_serves_as_well_as_a_calibration(images, calibration, tmp_path):
    dic.save_calibration(calibration, str(tmp_path / "cal.h5"))
    means = [
        dic.measure_images(*images, calibration=given).images[0].mean
        for given in (calibration, tmp_path / "cal.h5", str(tmp_path / "cal.h5"))
    ]
    assert means[0] == means[1] == means[2]


def test_a_grid_image_gives_a_calibration(draw_grid, tmp_path):
    drawn = draw_grid(pan_deg=20, noise=1)
    path = tmp_path / "grid.png"
    cv2.imwrite(str(path), drawn.image.astype(np.uint8))
    target = dic.targets.LineGridTarget((21, 21), pitch_mm=0.5)
    of_file = dic.calibrate_images(path, target)
    of_array = dic.calibrate_images([drawn.image.astype(np.uint8)], target, model="pinhole")
    assert of_file.source == str(path)
    assert (of_file.model, of_array.model) == ("bicubic", "pinhole")
    np.testing.assert_array_equal(dic.targets.find_target(str(path), target).uv_px, of_array.grid.uv_px)
    for calibration in (of_file, of_array):
        assert np.abs(calibration.map(drawn.uv_px) - drawn.xy_mm).max() < 0.01


class TestSeries:
    def test_an_image_that_cannot_be_measured_is_named_and_the_others_are_measured(self, images, folder):
        absent = folder / "absent.tif"
        flat = np.full(images[0].shape, 99.0, np.float32)
        series = dic.measure_images(images[0], [absent, flat, images[1]])
        assert [image.measurement is None for image in series.images] == [True, True, False]
        assert len(series.failures) == 2
        assert f"{absent}: read image: expected" in series.failures[0]
        assert "find the reference's pattern" in series.failures[1]
        assert_true(series.images[2].mean)
        with pytest.raises(dic.MeasurementError, match=r"absent\.tif: give strain"):
            _ = series.images[0].mean

    def test_images_are_taken_and_forgotten_one_by_one(self, images):
        taken = []

        def watched():
            for number in range(4):
                taken.append(number)
                yield images[number % 2]

        found = dic.measure_series(dic.correlation.Series(images[0]), watched())
        assert taken == []
        kept = []
        for image in found:
            kept.append(weakref.ref(image.measurement))
            assert len(taken) == len(kept)
            del image
            if len(kept) == 3:
                break
        assert taken == [0, 1, 2]
        assert all(measurement() is None for measurement in kept)

    def test_the_command_writes_what_python_is_given(self, folder, calibration, tmp_path):
        dic.save_calibration(calibration, tmp_path / "cal.h5")
        files = [folder / "reference.tif", folder / "deformed.tif"]
        options = ["--calibration", tmp_path / "cal.h5", "--motion", "tension", "--strain", "hencky"]
        done = run_dic("correlate", *files, *options, "--json", tmp_path / "r.json")
        series = dic.measure_images(
            *files,
            calibration=tmp_path / "cal.h5",
            strain=dic.StrainSettings(measure="hencky"),
            motion="tension",
        )
        (image,), (told,) = series.images, done.report["images"]
        assert told["raw"] == image.measurement.raw_mean.as_dict()
        parts = image.measurement.images_std
        assert told["calibrated"] == image.measurement.calibrated_mean.as_dict() | parts
        assert told["corrected"] == image.correction.as_dict()
        assert done.report["sensitivity"] == vars(series.sensitivity)

    def test_a_motion_needs_a_calibration(self, images):
        with pytest.raises(dic.errors.CorrelationError, match="expected a calibration"):
            dic.measure_images(*images, motion="rigid")
        with pytest.raises(dic.errors.CorrelationError, match="one of free, rigid, tension, got wild"):
            dic.measure_images(*images, motion="wild")

    def test_a_calibration_of_another_format_is_refused(self, images, calibration):
        with pytest.raises(dic.errors.CalibrationError, match="apply calibration: expected 180 × 160 px"):
            dic.measure_images(images[0][:-1], images[1][:-1], calibration=calibration)


@pytest.mark.extended
def test_a_run_file_gives_mean_strain_and_a_strain_map_in_six_lines(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    protocol = tmp_path / "short.toml"
    protocol.write_text(example("rotation", ("total_deg = 360.0", "total_deg = 45.0")))
    rig = tmp_path / "rig.toml"
    rig.write_text(example("rig-virtual-rotation-30", small_cameras(600, 1400.0)))
    assert run_protocol(protocol, rig, tmp_path / "run.h5")
    code = """
import dic
run = dic.process_run("run.h5", dic.CorrelationSettings(step_px=40, shape="quadratic"))
series = run.series("off_axis")
mean, strain = series.images[-1].mean, series.images[-1].strain.exx
dic.write_maps(series.images[-1].measurement, series.reference, "strain.png")
"""
    found = {}
    exec(code, found)
    # a specimen that is rotated is not strained; what the calibration leaves of the tilt is over 500 µε
    mean = found["mean"]
    assert np.abs([mean.exx, mean.eyy, mean.exy]).max() < 20e-6
    assert np.nanmedian(np.abs(found["strain"])) < 200e-6
    assert (tmp_path / "strain.png").is_file()
    run = found["run"]
    assert repr(run).count("\n") == 2
    assert "off_axis" in repr(run)
    assert [image.label for image in found["series"].images] == ["step 2", "step 3"]
    with pytest.raises(dic.errors.RunFileError, match=r"choose a camera: expected .*off_axis.*, got above"):
        run.series("above")


COLOUR = np.zeros((64, 64, 3), np.uint8)
GREY = np.zeros((64, 64), np.uint8)


def speckled_image() -> np.ndarray:
    pattern = gaussian_filter(np.random.default_rng(1).normal(size=(64, 64)), 1.5)
    return np.rint(128 + 200 * pattern / np.abs(pattern).max() / 2).astype(int)


@cache
def speckled() -> dic.Correlator:
    return dic.Correlator(speckled_image())


@cache
def field() -> dic.correlation.Field:
    return speckled().correlate(speckled_image())


WRONG = [
    (lambda: dic.Correlator("absent.tif"), "absent.tif: read image"),
    (lambda: dic.Correlator(COLOUR), "reference image: read: .* got a colour image of 64 × 64 px"),
    (lambda: dic.Correlator([[1, 2], [3, 4]]), "reference image: .* got a list"),
    (lambda: dic.Correlator(GREY > 0), "got values of type bool"),
    (lambda: dic.Correlator(GREY[None, None]), "got an array of shape \\(1, 1, 64, 64\\)"),
    (
        lambda: dic.Correlator(GREY, dic.CorrelationSettings()),
        "region of interest: .* got a CorrelationS",
    ),
    (lambda: dic.Correlator(GREY, GREY[:9]), "a mask of 64 x 64 px, got 64 x 9 px"),
    (lambda: dic.Correlator(GREY, None, dic.StrainSettings()), "settings: .* got a StrainSettings"),
    (lambda: speckled().correlate(GREY, hint=30.0), "hint: .* got an array of shape \\(\\)"),
    (lambda: speckled().correlate(GREY, hint="up"), "hint: .* got a str"),
    (lambda: speckled().correlate(GREY, hint=np.full((3, 3), np.nan)), "takes points to infinity"),
    (lambda: speckled().correlate(GREY, previous=GREY), "previous: expected a Field or None, got a ndarray"),
    (lambda: dic.correlation.Series(GREY, incremental="now"), "auto or never or always, got now"),
    (lambda: dic.measure("deformed.tif"), "field: expected a Field, got a str; correlate first"),
    (lambda: dic.measure_images(GREY, GREY, calibration=3), "calibration: expected a Calibration or None"),
    (lambda: dic.measure_images(GREY, GREY, settings=dic.StrainSettings()), "got a StrainSettings"),
    (lambda: dic.measure_images(GREY, GREY, motion=3), "motion: expected a Motion"),
    (lambda: dic.targets.find_target(GREY, "grid"), "target: expected a LineGridTarget or .* got a str"),
    (lambda: dic.targets.find_target(COLOUR), "got a colour image"),
    (lambda: dic.calibrate_images([]), "at least one image"),
    (lambda: dic.calibrate_images([GREY, GREY[1:]]), "images by one camera"),
    (lambda: dic.assess_quality(COLOUR), "got a colour image"),
    (lambda: dic.assess_quality(GREY, GREY[1:]), "a mask of 64 x 64 px"),
    (lambda: dic.process_run("absent.h5"), "absent.h5: .* no such file"),
    (lambda: dic.process_run("absent.h5", incremental="now"), "auto or never or always, got now"),
    (lambda: dic.load_calibration("absent.h5"), "absent.h5: .* no such file"),
    (lambda: dic.load_run_result("absent.h5"), "absent.h5: .* no such file"),
    (lambda: dic.measure_images(GREY, COLOUR), "deformed image: read: .* got a colour image of 64 × 64 px"),
    (
        lambda: dic.measure_images(GREY, 5),
        "images: expected an Iterable, got an int; give one image",
    ),
    (lambda: dic.read_image(GREY), "path: expected a str or a Path, got a ndarray; name an image file"),
    (lambda: dic.write_maps(GREY, GREY, "m.png"), "measurement: expected a Measurement, got a ndarray"),
    (lambda: dic.results.write_csv(field(), "m.csv"), "got a Field; measure first: dic.measure\\(field\\)"),
    (lambda: dic.process_run(GREY), "path: expected a str or a Path, got a ndarray; name a run file"),
    (
        lambda: dic.write_report("run.h5", "r.html"),
        "results: expected a RunResult, got a str; process",
    ),
    (lambda: dic.pipeline.save_run_result(field(), "r.h5"), "result: expected a RunResult, got a Field"),
    (lambda: dic.save_calibration(GREY, "c.h5"), "calibration: expected a Calibration, got a ndarray"),
]


@pytest.mark.parametrize(("call", "sentence"), WRONG, ids=[sentence[:40] for _, sentence in WRONG])
def test_a_wrong_argument_is_one_sentence(call, sentence):
    with pytest.raises(dic.MeasurementError, match=sentence) as refusal:
        call()
    assert "\n" not in str(refusal.value)


def test_what_python_prints_of_a_result_is_short():
    results = [
        speckled(),
        dic.correlation.Series(speckled_image()),
        field(),
        dic.measure(field()),
        dic.CorrelationSettings(),
    ]
    for result in results:
        shown = repr(result)
        assert len(shown) < 250
        assert shown.startswith(type(result).__name__)
        assert " object at " not in shown
    assert "64 × 64 px" in repr(results[0])


class TestSettings:
    def test_all_mistakes_are_reported_together_each_with_a_value_that_works(self):
        with pytest.raises(dic.errors.CorrelationError) as refusal:
            dic.CorrelationSettings(subset_px=30, step_px=0, shape="cubic", order=4, min_zncc=2.0)
        told = str(refusal.value)
        for words in ("subset", "step", "shape function", "spline order", "smallest ZNCC"):
            assert f"settings: {words}: expected" in told
        assert "got 30; give a subset between 11 and 101 px, odd" in told

    @pytest.mark.parametrize(
        "wrong",
        [
            {"subset_px": 31.0},
            {"subset_px": "31"},
            {"step_px": True},
            {"min_zncc": "0.8"},
            {"min_zncc": float("nan")},
            {"tolerance_px": float("inf")},
        ],
        ids=str,
    )
    def test_text_truth_and_what_is_not_finite_are_no_numbers(self, wrong):
        with pytest.raises(dic.errors.CorrelationError, match="settings: "):
            dic.CorrelationSettings(**wrong)

    def test_numbers_of_numpy_are_numbers(self):
        assert dic.CorrelationSettings(subset_px=np.int64(21), min_zncc=np.float32(0.5)).radius_px == 10

    def test_a_command_reports_the_mistakes_of_all_its_options_together(self):
        files = [EXAMPLES / "images" / name for name in ("reference.png", "loaded.png")]
        options = {
            "--subset": (30, "subset"),
            "--strain-window": (4, "strain window"),
            "--incremental": ("now", "incremental correlation"),
            "--hint": ("up", "hint"),
            "--motion": ("wild", "motion"),
            "--poisson-ratio": (3, "Poisson's ratio"),
        }
        words = [word for option, (value, _) in options.items() for word in (option, value)]
        done = run_dic("correlate", *files, *words)
        assert done.status == 2
        for _, what in options.values():
            assert f"settings: {what}: expected" in done.err
        assert done.err.count("\n") == 1


def test_values_say_in_a_line_what_they_are(images, calibration):
    series = dic.measure_images(*images, calibration=calibration, motion="tension")
    image = series.images[0]
    measurement = image.measurement
    values = [
        image, image.correction, image.mean, image.strain, measurement, measurement.field, measurement.raw,
        measurement.raw.noise, calibration, calibration.grid, calibration.bicubic, calibration.pinhole,
        *calibration.residuals.values(), dic.assess_quality(images[0]), measurement.settings,
    ]  # fmt: skip
    for value in values:
        shown = repr(value)
        assert shown.startswith(f"{type(value).__name__}(")
        assert "\n" not in shown
        assert len(shown) < 400
    assert f"exx {1e6 * image.mean.exx:.0f} ± " in repr(image.mean)
    assert repr(series).splitlines()[0] == "MeasuredSeries of 1 images, 0 failed"
