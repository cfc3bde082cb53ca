"""Tests of the public names of all packages."""

import ast
import doctest
import importlib
import inspect
import operator
import subprocess
import sys

import pytest

import dic

PACKAGES = ("dic", "drivers", "rig", "simulators")
EXAMPLES_NEED_NO_FILES = ("drivers", "simulators")


ONCE_AT_THE_TOP = """
EXPORTS GAUGES TARGETS AboutTest Alignment Animation Assessment AsymmetricDotTarget BicubicMap
Calibration CalibrationError CameraResult Campaign CampaignSpecimen CharucoTarget CheckerboardTarget
ClusterWorkers Comparison Correction CorrectionSettings Corrections CorrelationError CorrelationSettings
Correlator Curve CurveColumns CurveError Difference Displacement DotTarget Export Extensometer Field
Gauge GaugeChoice GaugeCurve GaugeError GaugeImage GaugeSeries GridPoints ImageClock ImageError
JoinedRecord JointCorrections KnownCamera LineCut LineGridTarget LocalWorkers MachineRecord MapSettings
MeanStrain MeasuredImage MeasuredSeries Measurement MeasurementError Motion Noise OutputError PeerField
Pinhole Plane PlotSettings PointGauge Profile Properties PropertySettings PropertyValue Quality Reading
ReferenceSettings RegionFiles ReportDetails Residuals ResultPlace RunCorrections RunFileError RunInfo
RunReference RunResult RunSource RunStep Sensitivity Series SeriesImage SeriesResult Specimen
SpecimenTest StatedFacts Status StrainField StrainGauge StrainSettings StudiedSettings Study
SurfaceSettings Sweep Target TensileTest TransverseExtensometer TwoCameraStep Wave WorkerError
assess_method assess_quality calibrate_images compare_results compare_specimens corrected_rotation
draw_target export_results find_specimen find_target gauge_curve gauge_table_files gauge_text
join_record list_images list_specimens load_alignment load_calibration load_run_result
load_series_result map_scale material_properties measure measure_campaign measure_gauges measure_images
measure_series planar_anisotropy plot_assessment plot_calibration plot_campaign plot_cuts plot_gauges
plot_properties plot_quality plot_study process_run quality_findings read_campaign read_curve
read_gauges read_image read_image_times read_machine_record read_peer read_region read_stated_facts
region_files rigid_motion run_reference save_alignment save_calibration save_run_result strain_of_run
strain_of_series strain_resolution_px study_settings tables_of_test tensile_test to_pandas to_xarray
whole_field_gauges with_shared_error write_animation write_campaign_report write_campaign_table
write_contact_sheet write_csv write_drawing_page write_example write_gauge_picture write_gauge_table
write_maps write_region write_report write_series_report write_strain_table write_tensile_ontology
write_test_ontology
""".split()  # noqa: SIM905


@pytest.mark.parametrize("name", PACKAGES)
def test_every_public_name_is_there(name):
    package = importlib.import_module(name)
    assert set(package.__all__) <= set(dir(package))
    for public in package.__all__:
        assert getattr(package, public) is not None


def test_most_of_dic_is_in_packages_below_it():
    packages = [name for name in dic.__all__ if inspect.ismodule(getattr(dic, name))]
    assert len(dic.__all__) - len(packages) <= 40
    assert len(packages) > 20
    listed = [f"{package}.{name}" for package in packages for name in getattr(dic, package).__all__]
    for place in listed:
        assert operator.attrgetter(place)(dic) is not None
    # One name, one meaning: an old script may find a name at the top, wherever the name is.
    assert len({place.partition(".")[2] for place in listed}) == len(listed)


@pytest.mark.filterwarnings("ignore:dic:DeprecationWarning")
def test_names_that_were_at_the_top_still_are_there():
    assert [name for name in ONCE_AT_THE_TOP if not hasattr(dic, name)] == []


@pytest.mark.parametrize(
    ("name", "now"),
    [
        ("dic.read_peer", "dic.comparison.read_peer"),
        ("rig.Status", "rig.EngineStatus"),
        ("simulators.Specimen", "simulators.SimulatedSpecimen"),
    ],
)
def test_an_old_name_is_the_new_one_with_a_warning(name, now):
    package, _, rest = now.partition(".")
    with pytest.warns(DeprecationWarning, match=f"{name} is {now} now"):
        found = getattr(importlib.import_module(package), name.partition(".")[2])
    assert found is operator.attrgetter(rest)(importlib.import_module(package))


@pytest.mark.parametrize("name", PACKAGES)
def test_a_name_that_is_not_there_is_an_attribute_error(name):
    with pytest.raises(AttributeError, match=f"No {name} attribute nothing"):
        _ = importlib.import_module(name).nothing


@pytest.mark.parametrize("name", PACKAGES)
def test_importing_it_loads_nothing_of_others(name):
    script = f"import sys; before = set(sys.modules); import {name}; print(sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = {module.partition(".")[0] for module in ast.literal_eval(done.stdout)}
    assert loaded <= {name, "lazy_loader"} | set(sys.stdlib_module_names)


@pytest.mark.parametrize("name", EXAMPLES_NEED_NO_FILES)
def test_its_example_prints_what_it_says(name):
    found = doctest.testmod(importlib.import_module(name))
    assert (found.failed, found.attempted > 0) == (0, True)
