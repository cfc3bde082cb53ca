"""Tables of `acquire` protocols: their documentation, times, numbers and words."""

import math
import re
import tomllib

import numpy as np
import pytest

from rig.commands.plan import plan_lines
from rig.protocol.acquire import AcquireProtocol
from rig.protocol.acquisition_tables import End, Schedule
from rig.run import plan_protocol
from tests.places import DOCS, EXAMPLES

SHORTEST = 'kind = "acquire"\ntitle = "t"\n'
SECTION = (DOCS / "protocols.md").read_text().split("## Images beside a machine")[1].split("\n## ")[0]


def read(acquire: str, end: str) -> AcquireProtocol:
    return AcquireProtocol.model_validate(tomllib.loads(f"{SHORTEST}[acquire]\n{acquire}\n[end]\n{end}\n"))


@pytest.mark.parametrize(("table", "model"), [("[acquire]", Schedule), ("[end]", End)])
def test_the_documentation_lists_every_key(table, model):
    rows = SECTION.split(f"| key of `{table}` |")[1].split("\n\n")[0]
    assert set(re.findall(r"^\| `([a-z_]+)", rows, re.MULTILINE)) == set(model.model_fields)


def test_the_example_of_the_documentation_is_a_protocol():
    (text,) = re.findall(r"```toml\n(.*?)```", SECTION, re.DOTALL)
    assert len(text.strip().splitlines()) == 6
    assert AcquireProtocol.model_validate(tomllib.loads(text)).planned_steps == 1203


def test_the_example_beside_a_closed_machine_is_planned_and_asks_for_its_signals():
    plan = plan_protocol(EXAMPLES / "beside.toml", EXAMPLES / "rig-virtual-closed.toml")
    assert plan.objections == []
    assert plan.acquisition.images is None
    assert plan.acquisition.images_per_hour == 3600.0
    text = "\n".join(plan_lines(plan))
    assert (
        "images every 1 s, until channels.crosshead above 1.9 is reached or channels.force falls by 30%"
        in text
    )
    other = plan_protocol(EXAMPLES / "beside.toml", EXAMPLES / "rig-virtual-tensile.toml")
    assert any("the protocol needs channels.crosshead" in objection for objection in other.objections)


@pytest.mark.parametrize(
    ("acquire", "end", "times_s", "words"),
    [
        ("every_s = 0.5", "duration_s = 2", [0.0, 0.5, 1.0, 1.5, 2.0], "every 0.5 s"),
        ("every_s = 0.1", "duration_s = 0.3", [0.0, 0.1, 0.2, 0.3], "every 0.1 s"),
        ("every_s = 0.5", "images = 3\nduration_s = 100", [0.0, 0.5, 1.0], "every 0.5 s"),
        ("times_s = [1.0, 7.0, 9.0]", "duration_s = 8", [1.0, 7.0], "at 3 times from 1 s to 9 s"),
        (
            "logarithmic = { first_s = 2, per_decade = 1 }",
            "duration_s = 2000",
            [0.0, 2.0, 20.0, 200.0, 2000.0],
            "at times that grow tenfold in 1 images, from 2 s",
        ),
        ("every_s = 0.5", 'reaches = { channel = "channels.f", above = 1 }', None, "every 0.5 s"),
        (
            'increment = { channel = "channels.f", by = 3 }',
            "duration_s = 5",
            None,
            "at each change of channels.f by 3",
        ),
        (
            'trigger = { channel = "channels.f", below = 3 }',
            "duration_s = 5",
            None,
            "each time channels.f below 3 begins",
        ),
        ("on_request = true", "on_request = true", None, "whenever the operator asks"),
    ],
)
def test_times_numbers_and_words(acquire, end, times_s, words):
    protocol = read(acquire, end)
    part = protocol.acquisition
    assert part.schedule.text == words
    found = part.schedule.times(part.duration_s, part.images)
    if times_s is None:
        assert found is None or len(found) > 10_000
        assert part.planned is None
    else:
        np.testing.assert_allclose(found, times_s)
        assert part.planned == len(times_s)
        dues = part.dues()
        dues.begin(100.0)
        np.testing.assert_allclose([dues.next_s() for _ in times_s], np.add(times_s, 100.0))
        if protocol.acquire.every_s is None:
            assert dues.next_s() == math.inf
    assert "the operator ends them" in part.end_of.text


def test_a_level_of_zero_is_shown_and_obeyed():
    level = read('trigger = { channel = "channels.f", above = 0 }', "images = 1").acquire.trigger
    assert str(level) == "channels.f above 0"
    assert (level.is_beyond(0.1), level.is_beyond(0.0), level.is_beyond(-1.0)) == (True, False, False)
