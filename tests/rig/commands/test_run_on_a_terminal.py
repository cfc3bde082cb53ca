"""A whole run on a terminal, as a person sees it. Another program simulates the rig."""

import json
import re
from contextlib import closing

import pytest

from tests.command_line import RIG
from tests.places import example
from tests.screens import TerminalProgram

pytestmark = [pytest.mark.realtime, pytest.mark.extended]

CAMERA = 'driver = "simulated-camera"'
TORN = re.compile(r"step \d+ \(.*step \d+ \(|settled at .*MOVES")


@pytest.fixture
def simulated_rig(start, tmp_path):
    """A rig file for a simulated tension rig with a person as operator, and the log of its true state."""
    rig_file, use, log = tmp_path / "simulated.toml", tmp_path / "use.toml", tmp_path / "truth.jsonl"
    small = f"{CAMERA}\nwidth_px = 64\nheight_px = 48"
    rig_file.write_text(example("rig-virtual-tension", (CAMERA, small)))
    start("simulate", rig_file, "-o", use, "--log", log).wait_for("scene:")
    tables, _, _ = use.read_text().partition("[operator]")
    use.write_text(f'{tables}[operator]\ndriver = "console-operator"\n')
    quick = (("rate_n_s = 200.0", "rate_n_s = 500.0"), ("dwell_s = 1.0", "dwell_s = 0.2"))
    (tmp_path / "quick.toml").write_text(example("tension", *quick))
    return use, log


@pytest.mark.parametrize("columns", [80, pytest.param(120, marks=pytest.mark.long)])
def test_a_newcomer_knows_at_each_moment_what_moves_and_how_to_stop_it(simulated_rig, tmp_path, columns):
    rig_file, log = simulated_rig
    command = [*RIG, "run", "quick.toml", "--rig", str(rig_file), "-o", "run.h5", "--json", "run.json"]
    with closing(TerminalProgram(command, columns, tmp_path)) as run:
        shown = run.wait_for("Type attached when it is done, Ctrl-C to end the run:")
        assert "Nothing moves: the load frame holds at " in shown
        assert "Please attach the calibration grid to the specimen." in shown
        # a hurried person answers the second question before it is asked, and then presses Enter
        run.type("attached\nremoved\n\n")
        run.wait_for("stand back: then the rig moves.\nType removed when it is done")
        run.type("done\n")
        shown = run.wait_for('"done" is not the word. Type removed when it is done')
        assert "step 0 (grid): settled at " in shown
        run.type("removed\n")
        shown = run.wait_for("step 2 (load 2000 N): the load frame MOVES, at ")
        assert "SIMULATED, 2 of 24 steps, Ctrl-C: the load frame holds" in shown
        run.type("\x03")
        assert run.end() == 1
        end = str(run.screen)
        seen = run.screen.seen
    # what moves and how to stop it always stand together
    moving = [lines for lines in map(str.splitlines, seen) if any("MOVES" in line for line in lines)]
    assert moving
    assert all("Ctrl-C: the load frame holds" in lines[-1] for lines in moving if "MOVES" not in lines[-1])
    # no line was written over another, and no rest of the drawing stays
    assert not any(TORN.search(line) for screen in seen for line in screen.splitlines())
    assert "MOVES" not in end
    assert "SIMULATED" not in end
    assert "got SIGINT; the finished" in end
    assert "aborted: 2 steps in run.h5" in end
    line = end.splitlines()[-1]
    found = re.fullmatch(r"The load frame holds at (-?[\d.]+) N and (-?[\d.]+) mm\.", line)
    assert found, line
    table = json.loads((tmp_path / "run.json").read_text())
    assert table["at_end"]["load_frame"]["holding"] is True
    assert table["at_end"]["load_frame"]["load_n"] == pytest.approx(float(found[1]), abs=0.06)
    truth = [json.loads(line) for line in log.read_text().splitlines()]
    samples = [line for line in truth if line["what"] == "sample"]
    assert samples[-1]["load_n"] == pytest.approx(float(found[1]), abs=20.0)


def test_a_person_pauses_a_motion_by_a_key_and_lets_it_go_on_by_a_word(simulated_rig, tmp_path):
    rig_file, log = simulated_rig
    command = [*RIG, "run", "quick.toml", "--rig", str(rig_file), "-o", "run.h5", "--json", "run.json"]
    with closing(TerminalProgram(command, 120, tmp_path)) as run:
        run.wait_for("Type attached when it is done")
        run.type("attached\n")
        run.wait_for("Type removed when it is done")
        run.type("removed\n")
        shown = run.wait_for("step 2 (load 2000 N): the load frame MOVES, at ")
        assert "Ctrl-C: the load frame holds, p: pause" in shown
        run.type("p")
        shown = run.wait_for("Type continue to let it go on, Ctrl-C to end the run:")
        assert "Nothing moves: the load frame holds at " in shown
        assert "The run is paused." in shown
        run.type("yes\n")
        run.wait_for('"yes" is not the word. Type continue')
        run.type("continue\n")
        run.wait_for("step 2 (load 2000 N): settled at ")
        run.wait_for("step 3 (load 4000 N): the load frame MOVES, at ")
        run.type("\x03")
        assert run.end() == 1
        end = str(run.screen)
    assert "got SIGINT; the finished" in end
    table = json.loads((tmp_path / "run.json").read_text())
    assert table["pauses"]["count"] == 1
    assert table["pauses"]["duration_s"] > 0.0
    assert [step["index"] for step in table["steps"]] == [0, 1, 2]
    truth = [json.loads(line) for line in log.read_text().splitlines()]
    assert [line for line in truth if line["what"] == "sample"][-1]["load_n"] < 4000.0


def test_a_person_asks_for_images_beside_a_closed_machine_and_ends_them(start, tmp_path):
    """The machine runs in another program, in real time. The person attaches the grid, and presses keys."""
    rig_file, use = tmp_path / "simulated.toml", tmp_path / "use.toml"
    small = ("width_px = 600\nheight_px = 600\nfocal_px = 1900.0", "width_px = 64\nheight_px = 48")
    rig_file.write_text(example("rig-virtual-closed", small))
    start("simulate", rig_file, "-o", use).wait_for("scene:")
    tables, _, _ = use.read_text().partition("[operator]")
    use.write_text(f'{tables}[operator]\ndriver = "console-operator"\n')
    protocol = example("beside").split("[acquire]")[0]
    asked = "[acquire]\non_request = true\n[end]\non_request = true\n"
    (tmp_path / "asked.toml").write_text(f"{protocol}{asked}")
    command = [*RIG, "run", "asked.toml", "--rig", str(use), "-o", "run.h5", "--json", "run.json"]
    with closing(TerminalProgram(command, 120, tmp_path)) as run:
        shown = run.wait_for("Type attached when it is done")
        assert "The load frame takes no commands, and shows " in shown
        assert "see for yourself that it stands" in shown
        run.type("attached\n")
        run.wait_for("Type removed when it is done")
        run.type("removed\n")
        shown = run.wait_for("p: pause, i: image, ee: end images")
        assert "Ctrl-C: the run ends" in shown
        for count in (1, 2, 3):
            run.type("i")
            run.wait_for(f"{count} images, force ")
        run.type("ee")
        assert run.end() == 0
        end = str(run.screen)
    assert "rig: 3 of 3 images taken" in end
    assert "The load frame takes no commands" in end
    table = json.loads((tmp_path / "run.json").read_text())
    assert (table["status"], table["timing"]["taken"]) == ("completed", 3)
