"""The rule of ASTM E3076-18 in simple code that fits every window separately, without running sums."""

import numpy as np


def slope_by_brute_force(x, y):
    """Return the first point, the end, the slope and the intercept of the line that the rule chooses."""
    largest = max(value - y[0] for value in y)
    start = next(k for k in range(len(y)) if y[k] - y[0] > 0.05 * largest)
    attempts = []
    seen = set()
    for raised in range(20):
        base = y[start] + (0.15 + 0.05 * raised) * largest
        later = [k for k in range(start + 1, len(y)) if y[k] > base and x[k] > x[start]]
        if not later:
            break
        cut = max(later, key=lambda k: (y[k] - base) / (x[k] - x[start]))
        if cut in seen or cut + 1 < 10:
            continue
        seen.add(cut)
        attempt = _attempt(x, y, cut)
        attempts.append(attempt)
        # Hardening is never half as steep as the elastic part.
        steepest = max(each["line"][2] for each in attempts)
        if not attempt["failed"] and attempt["line"][2] >= 0.5 * steepest:
            return attempt["line"]
    # No attempt passed all checks. Take the first attempt with the fewest failed checks; the check of the
    # range counts least.
    steep = [each for each in attempts if each["line"][2] >= 0.5 * steepest]
    return min(steep, key=lambda each: (each["failed"] - each["short"], each["failed"]))["line"]


def _attempt(x, y, cut):
    u = np.array([(x[k] - x[0]) / (x[cut] - x[0]) for k in range(cut + 1)])
    v = np.array([(y[k] - y[0]) / (y[cut] - y[0]) for k in range(cut + 1)])
    least = max(int(0.2 * len(u)), 10)
    best = (np.inf,)
    for first in range(len(u) - least + 1):
        for stop in range(first + least, len(u) + 1):
            part = v[first:stop]
            design = np.column_stack([u[first:stop], np.ones(stop - first)])
            _, square, _, _ = np.linalg.lstsq(design, part, rcond=None)
            normalised = float(square[0]) / float(((part - part.mean()) ** 2).sum())
            best = min(best, (normalised, first, stop))
    _, first, stop = best
    slope, intercept = np.polyfit(u[first:stop], v[first:stop], 1)
    failed = sum(_is_noisy(values) for values in (u, v)) + sum(_is_coarse(values) for values in (u, v))
    failed += _failed_quarters(u[first:stop], v[first:stop] - slope * u[first:stop] - intercept, slope)
    covered = v[first:stop].max() - v[first:stop].min()
    failed += stop == len(u)
    short = bool(covered < 0.4)
    failed += short
    line = (first, stop, *np.polyfit(x[first:stop], y[first:stop], 1))
    return {"line": line, "failed": failed, "short": short}


def _is_noisy(values):
    return np.diff(values).std(ddof=1) > 0.005


def _is_coarse(values):
    bins = [round(abs(each) * 4096) for each in np.diff(np.diff(values))]
    counts = {number: bins.count(number) for number in set(bins)}
    others = {number: count for number, count in counts.items() if number > 0}
    if not others:
        return False
    commonest = min(others, key=lambda number: (-others[number], number))
    share = max(counts.get(0, 0), others[commonest]) / len(bins)
    return commonest > 3 and share > 0.25


def _failed_quarters(x, rest, slope):
    width = x.max() - x.min()
    failed = 0
    for inside in (x <= x.min() + width / 4, x >= x.max() - width / 4):
        if inside.sum() < 5 or abs(np.polyfit(x[inside], rest[inside], 1)[0]) > 0.05 * slope:
            failed += 1
    return failed
