"""The output of `dic study`: the assumptions, a table of the best settings, and the recommendation."""

from __future__ import annotations

import textwrap

import dic

_BEST = 8
"""Number of settings in the table of the smallest errors."""
_FRONT = 6
"""Largest number of settings in the table of the Pareto front."""

_WIDTH = 100
_HEAD = (
    "                                          strain, µε           u and v, mpx\n"
    "  shape     subset  step  window  90 % at   noise   bias  error   noise  error"
)


def table(study: dic.study.Study, name: str) -> str:
    """Return the result of a study as text, with lines of at most 100 columns."""
    best, wave = study.recommended, study.wave
    source = {"given": "given", "default": "by default"}.get(study.wave_from, f"from {study.wave_from}")
    across = "" if wave.is_plane else f" along and {wave.across_px:.0f} px across"
    assumed = f"±{1e6 * wave.strain_amplitude:.0f} µε, period {wave.period_px:.0f} px{across} ({source})"
    noise = f"{study.noise:.2f} grey levels, drawn" if study.noise_from == "reference" else study.noise_from
    lines = [f"{name}: {len(study.settings)} settings on {_parts(study)}"]
    if study.specimen is not None and not study.specimen.is_whole:
        lines.append(f"  {study.specimen}")
    for note in study.notes:
        lines += textwrap.wrap(note, _WIDTH, initial_indent="  ", subsequent_indent="    ")
    for line in (f"strain   {assumed}", f"noise    {noise}"):
        lines += textwrap.wrap(line, _WIDTH, initial_indent="  ", subsequent_indent=" " * 11)
    lines += ["", "least error of strain:", _HEAD]
    lines += [_row(each, "*" if each is best else " ") for each in study.best[:_BEST]]
    lines += ["", "least noise for a resolution (Pareto front, some of it):", _HEAD]
    lines += [_row(each, "*" if each is best else " ") for each in _spread(study.front)]
    default = _choice(dic.CorrelationSettings(), dic.StrainSettings())
    usual = [each for each in study.settings if _choice(each.correlation, each.strain) == default]
    lines += ["", *(["the default settings:", _row(usual[0], " "), ""] if usual else [])]
    chosen = best.correlation
    lines.append(
        f"recommended: --shape {chosen.shape} --subset {chosen.subset_px} --step {chosen.step_px}"
        f" --strain-window {best.strain.window_points}"
    )
    least = study.best[0]
    if least is not best:
        less = 100 * (1 - best.subset_time / least.subset_time)
        more = 100 * (best.strain_error / least.strain_error - 1)
        lines.append(
            f"  it takes {less:.0f} % less time than {least.correlation.subset_px} px, with {more:.1f} % more"
            " error"
        )
    limits = study.limits_of_sweep()
    if limits:
        wider = "wider" if limits[0].startswith("widest") else "narrower"
        lines.append(f"  it has the {' and the '.join(limits)} tried: try {wider} ones too")
    if study.left_out:
        why = f"subsets narrower than three speckles ({study.narrowest_px:.0f} px), too wide windows"
        lines.append(f"  {study.left_out} settings left out: {why}")
    return "\n".join(lines)


def _parts(study: dic.study.Study) -> str:
    sizes = [f"{part.width} × {part.height} px" for part in study.parts]
    return f"a region of {sizes[0]}" if len(sizes) == 1 else f"{len(sizes)} parts of {sizes[0]}"


def _row(each: dic.study.StudiedSettings, mark: str) -> str:
    settings = each.correlation
    noise, bias = (
        1e6 * ((pair[0] ** 2 + pair[1] ** 2) / 2.0) ** 0.5 for pair in (each.strain_noise, each.strain_bias)
    )
    noise_px = 1e3 * ((each.noise_px[0] ** 2 + each.noise_px[1] ** 2) / 2.0) ** 0.5
    return (
        f"{mark} {settings.shape:<9} {settings.subset_px:>6} {settings.step_px:>5} "
        f"{each.strain.window_points:>7} {each.resolution_px:>5.0f} px {noise:>7.0f} {bias:>6.0f} "
        f"{1e6 * each.strain_error:>6.0f} {noise_px:>7.1f} {1e3 * each.error_px:>6.1f}"
    )


def _spread(front: tuple[dic.study.StudiedSettings, ...]) -> list[dic.study.StudiedSettings]:
    """Return some settings of the Pareto front, from the finest to the coarsest spatial resolution."""
    if len(front) <= _FRONT:
        return list(front)
    last = len(front) - 1
    return [front[round(number * last / (_FRONT - 1))] for number in range(_FRONT)]


def _choice(correlation: dic.CorrelationSettings, strain: dic.StrainSettings) -> tuple[object, ...]:
    return correlation.shape, correlation.subset_px, correlation.step_px, strain.window_points
