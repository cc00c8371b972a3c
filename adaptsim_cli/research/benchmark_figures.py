"""The figures of a benchmark: summaries -> inline SVG. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from adaptsim_cli.report.svg import Canvas, Scale
from sim.research.benchmark.summary import MethodSummary


def curve(method: MethodSummary, levels: Mapping[str, float]) -> str:
    """Mean reward against real trials, with its interval; `levels` are lines at references that need no trials."""
    canvas = Canvas(360, 200, f"Reward of {method.method} against real trials")
    left, right, top, bottom = 38.0, 350.0, 12.0, 166.0
    x, y = Scale(0.0, float(method.trials[-1]), left, right), Scale(0.0, 1.0, bottom, top)
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        canvas.line(left, y(tick), right, y(tick), "grid")
        canvas.text(left - 6, y(tick) + 4, f"{tick:g}", anchor="end")
    for name, reward in levels.items():
        canvas.line(left, y(reward), right, y(reward), "area")
        canvas.text(right, y(reward) - 4, name, anchor="end")
    points = [(x(float(n)), y(reward)) for n, reward in zip(method.trials, method.curve, strict=True)]
    for (at, _), (low, high) in zip(points, method.curve_ci95, strict=True):
        canvas.rect(at - 4, y(high), 8, max(y(low) - y(high), 1.0), "expected c0", 2)
    canvas.curve(points, "curve c0", method.method)
    for (at, height), n, reward in zip(points, method.trials, method.curve, strict=True):
        canvas.dot(at, height, 4, "dot c0", f"{n} trials: {reward:.3f}")
        canvas.text(at, bottom + 16, str(n), anchor="middle")
    return canvas.svg()


def differences(methods: Sequence[MethodSummary]) -> str:
    """Mean paired difference of each method to UDR, with its interval."""
    told = [(m, m.above_udr, m.above_udr_ci95) for m in methods]
    known = [(m, mean, ci) for m, mean, ci in told if mean is not None and ci is not None]
    height = 26.0 * len(known)
    canvas = Canvas(760, height + 40.0, "Difference of every method to UDR, paired by world, seed and contexts")
    ends = [end for _, _, ci in known for end in ci]
    x = Scale(min(-0.05, *ends), max(0.05, *ends), 170.0, 740.0)
    for tick in x.ticks(7):
        canvas.line(x(tick), 4.0, x(tick), height + 8.0, "mean" if abs(tick) < 1e-9 else "grid")
        canvas.text(x(tick), height + 26.0, f"{tick:+.2f}" if tick else "0", anchor="middle")
    for i, (method, mean, (low, high)) in enumerate(known):
        middle = 20.0 + 26.0 * i
        canvas.text(160.0, middle + 4.0, method.method, anchor="end")
        canvas.rect(x(low), middle - 5.0, max(x(high) - x(low), 1.5), 10.0, "expected c0", 3)
        canvas.dot(x(mean), middle, 4.5, "dot c0", f"{mean:+.3f} ({low:+.3f} to {high:+.3f})")
    return canvas.svg()
