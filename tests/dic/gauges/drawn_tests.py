"""Simulated tension tests with random specimens, seen 30° off-axis and evaluated to material properties.

The images of grid and specimen are rendered, and then measured with the default settings. Random values are
drawn for the camera's position and principal point, the noise of the images, the speckle pattern, the
mounting of the specimen, its tilt and shift under load, the material, the area, the load cell and the
positions of the gauges.
"""

from dataclasses import dataclass

import numpy as np

from dic import tensile_test
from dic.gauges import Extensometer, GaugeImage, GaugeSeries, TransverseExtensometer
from dic.gauges.placed import PlacedGauges
from dic.out_of_plane.correction import stated
from dic.out_of_plane.shift import Shift
from dic.out_of_plane.tension import correct_tilt
from dic.properties import PropertySettings
from simulators.scene.pose import Pose
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from tests.dic.out_of_plane.rendered import RenderedView

WIDTH_MM, THICKNESS_MM, LENGTH_MM = 25.0, 1.0, 60.0
ELASTIC_END = 0.65
"""Stress over the yield stress at which the shift reaches its drawn value.

The stated standard deviation of the shift holds at the end of the elastic window. For this material, the
objective window ends at 0.5 to 0.7 of the yield stress, depending on the noise.
"""
SHIFT_STD_UM, LOAD_STD_PERCENT, LOAD_NOISE_N = 0.3, 0.3, 2.0
WIDTH_STD_MM, THICKNESS_STD_MM = 0.01, 0.003
TILT_MOST_DEG = 0.15
# Stresses of the images over the yield stress: through the elastic part, and more closely past 0.2 %.
COURSE = np.concatenate([np.linspace(0.04, 0.82, 16), np.linspace(0.86, 1.06, 8)])
SHORT_COURSE = np.concatenate([np.linspace(0.08, 0.72, 6), [0.86, 0.96, 1.02, 1.08]])
NAMES = ("E_gpa", "nu", "Rp02_mpa")


@dataclass(frozen=True)
class Outcome:
    """Properties from one random test: true values, values without correction, and corrected values.

    `stress_error_percent` is the error of all stresses, from the gain of the load cell and from the area.
    """

    truth: dict
    uncorrected: dict
    corrected: dict
    stress_error_percent: float

    def error_percent(self, name, kind="corrected"):
        """Return the error of a value; NaN if the value is withheld, as E is where bias bends the curve."""
        value = getattr(self, kind)[name].value
        return float("nan") if value is None else 100.0 * (value / self.truth[name] - 1.0)

    def strain_error_percent(self):
        """Return the error that the corrected E would have if load and area were exact."""
        stress = 1.0 + self.stress_error_percent / 100.0
        return 100.0 * (self.corrected["E_gpa"].value / self.truth["E_gpa"] / stress - 1.0)

    def z(self, name):
        """Return the error of a corrected value, divided by its stated standard deviation."""
        value = self.corrected[name]
        return (value.value - self.truth[name]) / value.std


def drawn_test(seed, *, course=COURSE, shift_std_um=SHIFT_STD_UM, window=None):
    """Return the properties from one random tension test, which `seed` determines.

    If `window` is given, the elastic slope is fitted between these two fractions of the yield stress.
    Otherwise the range of the fit is chosen objectively.
    """
    rng = np.random.default_rng([seed, 15])
    material = _material(rng)
    states, loads_n = _loaded(material, course)
    view, mounted_deg, gap_mm = _view(rng, seed)
    slopes_deg, shift_um = _motion(rng, shift_std_um)
    yield_n = material.yield_stress_mpa * material.area_mm2
    poses = [
        Pose.sloped(
            *(mounted_deg + slopes_deg * (1.0 - np.exp(-5.0 * load_n / yield_n))),
            gap_mm + 1e-3 * shift_um * load_n / (ELASTIC_END * yield_n),
        )
        for load_n in loads_n
    ]
    measurements = [
        view.measurement(pose, state.deformation_gradient())
        for pose, state in zip(poses, states, strict=True)
    ]
    gain = 1.0 + rng.normal(0.0, LOAD_STD_PERCENT / 100.0)
    shown_n = gain * loads_n + rng.normal(0.0, LOAD_NOISE_N, len(loads_n))
    series = _series(rng, measurements, view.calibration, material, shift_std_um, shown_n)
    area_mm2 = (WIDTH_MM + rng.normal(0.0, WIDTH_STD_MM)) * (THICKNESS_MM + rng.normal(0.0, THICKNESS_STD_MM))
    settings = PropertySettings(
        area_mm2=area_mm2,
        area_std_mm2=float(np.hypot(WIDTH_STD_MM * THICKNESS_MM, THICKNESS_STD_MM * WIDTH_MM)),
        load_std_percent=LOAD_STD_PERCENT,
        window_mpa=window and tuple(share * material.yield_stress_mpa for share in window),
    )
    test = tensile_test(series, "axial", "width", settings)
    uncorrected, corrected = (column.properties.values for column in test.columns)
    truth = {
        "E_gpa": material.youngs_modulus_mpa / 1e3,
        "nu": material.poisson_ratio,
        "Rp02_mpa": material.yield_stress_mpa,
    }
    stress_error_percent = 100.0 * (gain * material.area_mm2 / area_mm2 - 1.0)
    return Outcome(truth, uncorrected, corrected, stress_error_percent)


def _material(rng):
    modulus_mpa, yield_mpa = rng.uniform(65e3, 80e3), rng.uniform(280.0, 420.0)
    return SpecimenSettings(
        width_mm=WIDTH_MM,
        thickness_mm=THICKNESS_MM,
        parallel_length_mm=LENGTH_MM,
        youngs_modulus_mpa=modulus_mpa,
        poisson_ratio=rng.uniform(0.27, 0.36),
        yield_stress_mpa=yield_mpa,
        ultimate_stress_mpa=1.3 * yield_mpa,
        grip_slip_mm=0.0,
        machine_stiffness_n_mm=1e6,
    )


def _loaded(material, course):
    """Return the states and the true loads of a specimen at the stresses of `course`."""
    specimen, states = SimulatedSpecimen(material), []
    for share in course:
        while specimen.state.load_n < share * material.yield_stress_mpa * material.area_mm2:
            specimen.stretch_to(specimen.state.displacement_mm + 5e-4)
        states.append(specimen.state)
    return states, np.array([state.load_n for state in states])


def _view(rng, seed):
    """Return the calibrated camera, the slopes in degrees and distance in mm from grid to specimen."""
    around, mounted_deg, gap_mm = rng.uniform(0.0, 2 * np.pi), rng.normal(0.0, 0.1, 2), rng.normal(0.0, 0.3)
    view = RenderedView(
        seed,
        pan_deg=30.0 * np.cos(around),
        tilt_deg=30.0 * np.sin(around),
        reference=Pose.sloped(*mounted_deg, gap_mm),
    )
    return view, mounted_deg, gap_mm


def _motion(rng, shift_std_um):
    """Return the slopes under full load, degrees, and the shift at the end of the elastic window, µm."""
    away, tilt_deg = rng.uniform(0.0, 2 * np.pi), rng.uniform(0.0, TILT_MOST_DEG)
    return tilt_deg * np.array([np.cos(away), np.sin(away)]), rng.normal(0.0, shift_std_um)


def _series(rng, measurements, calibration, material, shift_std_um, shown_n):
    x, y = rng.uniform(-0.5, 0.5, 2)
    gauges = (
        Extensometer(name="axial", unit="mm", start=(x, y - 2.6), end=(x, y + 2.6), patch=1.6),
        TransverseExtensometer(
            name="width", unit="mm", start=(x - 2.6, y), end=(x + 2.6, y), patch=1.2, spread=5.0
        ),
    )
    placed, images = None, []
    for k, (measurement, load_n) in enumerate(zip(measurements, shown_n, strict=True)):
        correction = correct_tilt(
            measurement, calibration, material.poisson_ratio, Shift.of(shift_std_um, None)
        )
        measurement = stated(measurement, correction)
        placed = placed or PlacedGauges.of(gauges, measurement, calibration, (800, 800))
        readings = placed.read(measurement, correction)
        images.append(GaugeImage(f"image {k}", readings, {"load_n": float(load_n)}))
    return GaugeSeries("drawn test", gauges, tuple(images))
