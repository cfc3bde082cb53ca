"""While a test runs, the terminal shows its curve, its newest values, and what is wrong with them."""

import io
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace

import pytest
from rich.console import Console

from rig.commands.live_view import Panel, RunView
from rig.commands.progress import TOLD_EVERY_S, Screen, run_screen
from rig.engine.status import EngineStatus
from rig.news.images_now import ImageNow
from tests.rig.commands.live_runs import REASON, live_now, live_status
from tests.screens import terminal

IMAGES = {"off_axis": ImageNow(0.47, 0.0123, 0.98)}


def drawn(status: EngineStatus, columns: int, rows: int = 24, **console: object) -> list[str]:
    output = Console(file=io.StringIO(), width=columns, height=rows, force_terminal=True, **console)
    output.print(Panel(RunView(status, 12.3, IMAGES), [("what happens", False)], "the last line"))
    return output.file.getvalue().splitlines()


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_all_that_matters_is_on_the_terminal_and_fits_it(columns):
    lines = drawn(live_status(live_now(0.00521, lost=3)), columns, no_color=True, color_system=None)
    assert len(lines) <= 24
    assert max(map(len, lines)) <= columns
    text = " ".join(" ".join(lines).split())
    assert "1 axial 0.5210 ± 0.0020 %, corrected, off_axis" in text
    assert f"2 across NOT VALID: {REASON} (-0.1563 ± 0.0030 %, calibrated, on_axis)" in text
    assert "12.3 s, load 9117.5 N, displacement 0.4567 mm" in text
    assert "1234 frames recorded 10/s, 3 LOST, 5 not measured, gauges 98.7/s" in text
    assert "off_axis: brightness 47%, saturated 1.23%, sharpness 98% of the reference" in text
    assert text.endswith("what happens the last line")
    assert lines[0] == "stress, MPa"
    assert any("⠊" in line or "⠔" in line or "⡠" in line for line in lines)


def test_a_low_terminal_has_the_lines_and_no_plot():
    lines = drawn(live_status(live_now(0.005)), 80, rows=10, no_color=True, color_system=None)
    assert "stress, MPa" not in lines
    assert len(lines) <= 10
    assert lines[0].startswith("1 axial 0.5")


def test_colours_are_left_out_where_nobody_wants_them(monkeypatch):
    status = live_status(live_now(0.005))
    assert any("\x1b[36m" in line for line in drawn(status, 80, color_system="standard"))
    monkeypatch.setenv("NO_COLOR", "1")
    assert not any("\x1b[3" in line for line in drawn(status, 80))


def test_a_value_that_stays_is_said_to_be_old():
    view = RunView(live_status(live_now(0.005, time_s=10.0), time_s=13.2))
    assert ("1 axial 0.5000 ± 0.0020 %, corrected, off_axis, 3.2 s OLD", True) in view.lines()


def test_before_the_first_value_nothing_is_claimed():
    none_yet = replace(live_now(0.0), reading=None, curves={"axial": [], "across": []})
    view = RunView(live_status(replace(none_yet, curves={"axial": [(0.0, 0.0)]})))
    assert view.lines()[0] == ("no value of a gauge yet", False)
    assert "gauges" not in view.sentence()


def test_a_pipe_gets_one_line_in_ten_seconds_and_the_two_lines_of_a_terminal_never_come():
    class Clock:
        time_s = 0.0

        def now_s(self) -> float:
            return self.time_s

    out, err, clock = io.StringIO(), io.StringIO(), Clock()
    with redirect_stdout(out), redirect_stderr(err), run_screen() as screen:
        screen._clock = clock
        for second in range(31):
            clock.time_s = float(second)
            screen.on_status(live_status(live_now(0.0001 * second), time_s=float(second)))
    lines = out.getvalue().splitlines()
    assert len(lines) == 1 + 30 // int(TOLD_EVERY_S)
    assert lines[-1].startswith("30.0 s, load 5250.0 N, displacement 0.4567 mm, axial 0.3000 ± 0.0020 %")
    assert f"across NOT VALID: {REASON}" in lines[-1]
    assert err.getvalue() == ""


def test_the_screen_of_a_run_shows_the_curve_and_what_ctrl_c_does(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    with (
        terminal(80) as (stream, watched),
        redirect_stdout(stream),
        redirect_stderr(stream),
        run_screen() as screen,
    ):
        assert isinstance(screen, Screen)
        screen.on_status(live_status(live_now(0.004)))
        screen.live.refresh()
        screen.live.refresh()
    shown = max(watched.seen, key=len).splitlines()
    assert shown[0] == "stress, MPa"
    assert shown[-2] == ("step 2 (displacement 3 mm): the load frame MOVES, at 7000.0 N, 0.4567 mm")
    assert "SIMULATED, 2 of 4 steps, Ctrl-C: the load frame holds" in shown[-1]
    assert max(map(len, shown)) <= 80
    # nothing stays on the screen after the run
    assert watched.lines == []
