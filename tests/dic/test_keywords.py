"""An unknown argument of Python's users names the argument that was meant."""

import pytest

import dic


@pytest.mark.parametrize(
    ("call", "meant"),
    [
        (lambda: dic.CorrelationSettings(subset=21), "did you mean subset_px=…"),
        (lambda: dic.pictures.MapSettings(colors="grey"), "did you mean colours=…"),
        (
            lambda: dic.measure_images("a.png", "b.png", subset=21),
            r"did you mean settings=CorrelationSettings\(subset_px=…\)",
        ),
        (lambda: dic.process_run("run.h5", strain_window=5), "got 'strain_window'; "),
        (lambda: dic.targets.LineGridTarget(pitch=0.5), "did you mean pitch_mm=…"),
        (lambda: dic.write_report([], "r.html", titel=""), "did you mean title=…"),
        (lambda: dic.StrainSettings(rhubarb=1), "leave rhubarb out"),
    ],
)
def test_an_unknown_argument_names_the_one_that_was_meant(call, meant):
    with pytest.raises(TypeError, match=meant) as refusal:
        call()
    assert "\n" not in str(refusal.value)
