"""Maps show the kind of values that is asked for."""

from dataclasses import replace

import numpy as np
import pytest

import dic
from dic.out_of_plane.correction import Correction
from dic.pictures.contact_sheet import draw_contact_sheet
from dic.pictures.panels import maps_of
from tests.dic.pictures.fields import SHAPE, stretched

RAW = 0.004


@pytest.fixture(scope="module")
def measurement():
    """A specimen that is stretched to the right, and a camera that looks straight at it."""
    index = np.stack(np.meshgrid(np.arange(17), np.arange(17)), axis=-1).reshape(-1, 2)
    uv = index * (17.0, -13.0) + (14.0, 224.0)
    calibration = dic.Calibration.fit(dic.targets.GridPoints.on_lattice(index, uv, (17, 17), 0.75), SHAPE)
    return dic.measure(stretched(RAW), calibration)


def values(measurement, kind, correction=None, quantity="u"):
    settings = dic.pictures.MapSettings(quantities=(quantity,), kind=kind)
    (panel,) = maps_of(measurement, settings, correction).panels
    return panel


@pytest.fixture
def correction(measurement):
    """A correction that takes half of the displacement away."""
    found = measurement.calibrated
    half = replace(found, vector=0.5 * found.vector, noise=None)
    return Correction("tilt", measurement.mean, half, measurement.strain_settings)


def test_each_kind_has_its_own_displacement_and_unit(measurement, correction):
    raw, calibrated, corrected = (
        values(measurement, kind, correction) for kind in ("raw", "calibrated", "corrected")
    )
    assert [panel.unit for panel in (raw, calibrated, corrected)] == ["px", "mm", "mm"]
    x = measurement.field.x_px
    np.testing.assert_allclose(raw.values, np.broadcast_to(RAW * x, raw.values.shape), rtol=1e-9)
    np.testing.assert_allclose(calibrated.values, raw.values * 0.75 / 17.0, rtol=1e-6)
    np.testing.assert_allclose(corrected.values, 0.5 * calibrated.values, rtol=1e-9)


def test_each_kind_has_its_own_strain_and_name(measurement, correction):
    truth = {"raw": RAW, "calibrated": RAW, "corrected": 0.5 * RAW}
    for kind, strain in truth.items():
        panel = values(measurement, kind, correction, "exx")
        assert panel.name == f"εxx {kind}"
        np.testing.assert_allclose(np.nanmedian(panel.values), 1e6 * (strain + strain**2 / 2), rtol=1e-6)


def test_the_best_kind_is_that_which_the_image_has(measurement, correction):
    declined = replace(correction, declined="too little motion")
    plain = dic.measure(stretched(RAW))
    assert values(measurement, "best", correction, "exx").name == "εxx corrected"
    assert values(measurement, "best", declined, "exx").name == "εxx calibrated"
    assert values(plain, "best", None, "exx").name == "εxx raw"


def test_an_image_without_a_correction_has_no_corrected_values(measurement, correction):
    for given in (None, replace(correction, declined="too little motion")):
        for quantity in ("u", "exx"):
            assert np.isnan(values(measurement, "corrected", given, quantity).values).all()


@pytest.mark.parametrize("kind", ["calibrated", "corrected"])
def test_values_that_need_a_calibration_are_refused_without_one(kind):
    with pytest.raises(
        dic.MeasurementError, match=f"{kind} values in maps: expected a calibration, got none"
    ):
        values(dic.measure(stretched(RAW)), kind)


def test_an_unknown_kind_is_refused():
    with pytest.raises(dic.MeasurementError, match="kind of values of maps: expected one of best"):
        dic.pictures.MapSettings(kind="true")


def test_a_contact_sheet_of_different_kinds_names_the_kind_in_each_map(measurement):
    settings = dic.pictures.MapSettings(quantities=("exx",))
    declined = Correction.refused("tilt", measurement, "it necks")
    corrected = replace(declined, declined=None)
    for other, title, names in (
        (declined, "εxx, µε", ["a.png, corrected", "…_name_2.png, calibrated"]),
        (corrected, "εxx corrected, µε", ["a.png", "a_long_name_2.png"]),
    ):
        both = (("images/a.png", corrected), ("images/a_long_name_2.png", other))
        images = [(name, maps_of(measurement, settings, one)) for name, one in both]
        page = draw_contact_sheet(images, np.zeros(SHAPE, np.float32), 2, settings, {"exx": (0.0, 1.0)})
        texts = [text.text for text in page.texts]
        assert texts[-1] == title
        assert [text for text in texts if ".png" in text or "…" in text] == names
