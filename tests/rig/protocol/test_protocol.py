import math
from pathlib import Path

import pytest
from pydantic import ValidationError

from drivers.errors import ConfigurationError
from rig.errors import ProtocolError
from rig.protocol.course import increments
from rig.protocol.plasticity import PlasticCriterion
from rig.protocol.protocol import read_protocol
from rig.protocol.step import RigReading
from rig.protocol.tension import TensionProtocol
from tests.places import EXAMPLES, example

KINDS = "kind: 'tension', 'rotation', 'phases' or 'acquire' is expected"


def edited(tmp_path: Path, name: str, *edits: tuple[str, str]) -> Path:
    path = tmp_path / "protocol.toml"
    path.write_text(example(name, *edits))
    return path


def test_tension_example_is_the_papers_procedure():
    steps = read_protocol(EXAMPLES / "tension.toml").steps()
    assert [step.kind for step in steps[:5]] == ["grid", "reference", "static", "static", "load"]
    assert [step.at_s for step in steps[2:4]] == [5.0, 10.0]
    assert [step.target for step in steps if step.kind == "load"] == [2000.0, 4000.0, 6000.0, 8000.0, 10000.0]
    stretch = [step.target for step in steps if step.kind == "displacement"]
    assert stretch == pytest.approx([0.3 * i for i in range(1, 17)] + [5.0])
    assert [step.index for step in steps] == list(range(len(steps)))


def test_rotation_example_is_the_papers_procedure():
    steps = read_protocol(EXAMPLES / "rotation.toml").steps()
    assert [step.kind for step in steps[:4]] == ["grid", "reference", "static", "static"]
    assert [step.target for step in steps[4:]] == [22.5 * i for i in range(1, 17)]
    assert not any(step.conditional for step in steps)


def test_only_increments_after_the_first_judged_one_are_conditional():
    steps = read_protocol(EXAMPLES / "tension.toml").steps()
    assert [step.target for step in steps if step.kind == "load" and step.conditional] == [8000.0, 10000.0]


def test_the_first_increment_has_none_to_be_compared_with(tmp_path):
    path = edited(tmp_path, "tension", ("judged_above_n = 4000.0", "judged_above_n = 0.0"))
    loads = [step for step in read_protocol(path).steps() if step.kind == "load"]
    assert [step.conditional for step in loads] == [False, False, True, True, True]


def test_three_mistakes_are_reported_together_with_path_and_expectation(tmp_path):
    path = edited(
        tmp_path,
        "tension",
        ("thickness_mm = 1.0", "thickness_mm = -1.0"),
        ("rate_n_s = 200.0", 'rate_n_s = "fast"'),
        ("dwell_s = 1.0", "dwel_s = 1.0"),
    )
    with pytest.raises(ConfigurationError) as caught:
        read_protocol(path)
    mistakes = caught.value.mistakes
    assert "sample.thickness_mm: input should be greater than 0, got -1.0" in mistakes
    assert "loading.rate_n_s: input should be a valid number, got 'fast'" in mistakes
    assert "settle.dwel_s: unknown key; remove it or correct its name" in mistakes
    assert "settle.dwell_s: is missing; add it" in mistakes
    assert str(caught.value).startswith(f"{path}: 4 mistakes")


def test_unknown_kind_does_not_hide_other_mistakes(tmp_path):
    path = edited(
        tmp_path, "rotation", ('"rotation"', '"rotate"'), ("increment_deg = 22.5", "increment_deg = 0")
    )
    with pytest.raises(ConfigurationError) as caught:
        read_protocol(path)
    assert f"{KINDS}, got 'rotate'" in caught.value.mistakes
    assert "rotation.increment_deg: input should be greater than 0, got 0" in caught.value.mistakes


def test_contradictions_between_tables_are_reported_together(tmp_path):
    path = edited(
        tmp_path,
        "tension",
        ("load_max_n = 13000.0", "load_max_n = 9000.0"),
        ("displacement_max_mm = 5.2", "displacement_max_mm = 5.0"),
        ("timeout_s = 60.0", "timeout_s = 12.0"),
        ("increment_mm = 0.3", "increment_mm = 0.003"),
    )
    with pytest.raises(ConfigurationError) as caught:
        read_protocol(path)
    (mistake,) = caught.value.mistakes
    assert "limits.load_max_n must be at least 10020" in mistake
    assert "limits.displacement_max_mm must be at least 5.002" in mistake
    assert "stretching.increment_mm must be more than twice its settle tolerance" in mistake


def test_step_that_cannot_be_over_before_its_deadline_is_a_mistake(tmp_path):
    path = edited(tmp_path, "tension", ("timeout_s = 60.0", "timeout_s = 12.0"))
    with pytest.raises(ConfigurationError, match=r"stretching.increment_mm .* take 16 s together"):
        read_protocol(path)


def test_file_that_is_no_toml_is_one_sentence(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text('kind = "tension\n')
    with pytest.raises(ConfigurationError, match="is not valid TOML"):
        read_protocol(path)


@pytest.mark.parametrize(
    ("start", "expected"),
    [
        (4.2, [4.5, 4.8, 5.0]),
        (4.4, [4.7, 5.0]),
        (4.6995, [5.0]),
        (4.999, []),
        (5.3, []),
    ],
)
def test_increments_end_at_the_total_whatever_remains(start, expected):
    targets = increments(start, 5.0, 0.3, 0.002)
    assert targets == pytest.approx(expected)
    assert targets[-1:] in ([5.0], [])


# Bilinear specimen in soft grips: seats over 1 kN at 5 kN/mm, 20 kN/mm elastic, 2 kN/mm plastic above 7 kN.
def grips_mm(load_n: float) -> float:
    seat, elastic, plastic = (
        min(load_n, 1000.0),
        min(max(load_n - 1000.0, 0.0), 6000.0),
        max(load_n - 7000.0, 0.0),
    )
    return seat / 5000.0 + elastic / 20000.0 + plastic / 2000.0


def test_soft_grips_are_not_plastic_and_yielding_is():
    criterion = PlasticCriterion(stiffness_fraction=0.8, judged_above_n=0.0)
    loads_n = [0.0, 2000.0, 4000.0, 6000.0, 8000.0]
    verdicts = [
        criterion.is_evident(loads_n[: k + 1], [grips_mm(load_n) for load_n in loads_n[: k + 1]])
        for k in range(1, len(loads_n))
    ]
    assert verdicts == [False, False, False, True]


@pytest.mark.parametrize(("fraction", "plastic"), [(0.49, False), (0.51, True)])
def test_plastic_means_below_the_declared_fraction_of_the_stiffest_increment(fraction, plastic):
    criterion = PlasticCriterion(stiffness_fraction=fraction, judged_above_n=0.0)
    # 10, 20 and 10 kN/mm: half of the stiffest, and equal to the first.
    assert criterion.is_evident([0.0, 1000.0, 2000.0, 3000.0], [0.0, 0.1, 0.15, 0.25]) is plastic


def test_displacement_that_does_not_grow_under_load_is_an_error():
    criterion = PlasticCriterion(stiffness_fraction=0.8, judged_above_n=0.0)
    with pytest.raises(ProtocolError, match="displacement transducer"):
        criterion.is_evident([0.0, 2000.0], [0.0, 0.0])


def test_slip_below_the_judged_load_does_not_end_the_loading(tension_table):
    # An early slip: the increment to 4000 N is three times as soft as the one before.
    slip_mm = {2000.0: 0.1, 4000.0: 0.4, 6000.0: 0.5, 8000.0: 0.6, 10000.0: 1.6}
    executed = []

    def execute(step):
        executed.append(step)
        if step.kind == "displacement":
            return RigReading(0.0, 10000.0, step.target)
        load_n = 0.0 if math.isnan(step.target) else step.target
        return RigReading(0.0, load_n, slip_mm.get(load_n, 0.0))

    TensionProtocol.model_validate(tension_table).follow(execute)
    assert [step.target for step in executed if step.kind == "load"] == [
        2000.0,
        4000.0,
        6000.0,
        8000.0,
        10000.0,
    ]
    assert executed[-1].target == 5.0


def test_bool_is_no_number(tension_table):
    tension_table["images"]["per_step"] = True
    with pytest.raises(ValidationError):
        TensionProtocol.model_validate(tension_table)


@pytest.mark.parametrize("example", ["tension", "rotation"])
def test_unknown_kind_is_told_both_that_are_known(tmp_path, example):
    path = edited(tmp_path, example, (f'kind = "{example}"', 'kind = "torsion"'))
    with pytest.raises(ConfigurationError) as caught:
        read_protocol(path)
    assert caught.value.mistakes == [f"{KINDS}, got 'torsion'"]


def test_text_that_would_break_a_run_file_or_a_table_is_a_mistake(tmp_path):
    path = edited(tmp_path, "rotation", ('title = "', r'title = "a\u0000b'), ('name = "', r'name = "a\nb'))
    with pytest.raises(ConfigurationError) as caught:
        read_protocol(path)
    assert [mistake.split(":")[0] for mistake in caught.value.mistakes] == ["title", "sample.name"]


def test_endless_text_is_not_repeated_in_the_complaint(tmp_path):
    with pytest.raises(ConfigurationError) as caught:
        read_protocol(edited(tmp_path, "rotation", ('title = "', 'title = "' + 5000 * "x")))
    assert len(str(caught.value)) < 300


def test_byte_order_mark_is_called_by_its_name(tmp_path):
    path = tmp_path / "protocol.toml"
    path.write_text((EXAMPLES / "rotation.toml").read_text(), encoding="utf-8-sig")
    with pytest.raises(ConfigurationError, match="byte order mark"):
        read_protocol(path)
