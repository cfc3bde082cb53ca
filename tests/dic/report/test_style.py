"""The report's figures have enough room for labels and legend."""

import pytest

from dic.report.style import legend_below, new_figure, plot_style
from tests.dic.pictures.boxes import assert_apart_inside


@pytest.mark.parametrize("panels", [2, 3])
@pytest.mark.parametrize("lines", [1, 9])
def test_labels_and_legend_are_inside_the_figure_and_do_not_cover_each_other(panels: int, lines: int) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with plot_style():
        figure, axes = new_figure(panels, 4.0)
        for axis in axes:
            for line in range(lines):
                axis.plot([0.0, 1.0], [-1e5, 1e5 + line], label=f"off_axis 30.0°, line {line}")
            axis.set(xlabel="step (shaded: load control)", ylabel="Δεxx corrected, µε")
        legend_below(figure, columns=3)
        FigureCanvasAgg(figure).draw()
        boxes = [axis.get_tightbbox() for axis in axes] + [figure.legends[0].get_window_extent()]
    assert_apart_inside(figure, boxes)


@pytest.mark.parametrize("letter", [pytest.param("x", marks=pytest.mark.extended), "W"])
def test_forty_long_names_leave_room_for_the_axes(letter: str) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    names = [letter * 78 + f"{number:02}" for number in range(40)]
    with plot_style():
        figure, axes = new_figure(2, 4.6)
        figure.set_dpi(130)
        figure.subplots_adjust(top=0.93)
        for axis in axes:
            for name in names:
                axis.plot([0.0, 1.0], [0.0, 1.0], label=name)
            axis.set(xlabel="strain, %", ylabel="stress, MPa", title="whole curves")
        legend_below(figure, columns=len(names))
        FigureCanvasAgg(figure).draw()
        boxes = [axis.get_tightbbox() for axis in axes] + [figure.legends[0].get_window_extent()]
        assert all(axis.get_window_extent().height >= 1.9 * figure.dpi for axis in axes)
    assert_apart_inside(figure, boxes)
    shown = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [text[-2:] for text in shown] == [name[-2:] for name in names]
