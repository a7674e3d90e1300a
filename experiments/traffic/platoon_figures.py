"""Platoons as pictures."""

from pathlib import Path

import numpy as np

from experiments.traffic.platoon import Platoon
from urbanjax.io.figures.style import BAD, GOOD, LINE, figure, shades


def draw_speeds(found: list[Platoon], path: Path) -> None:
    """Speeds over time, vehicle by vehicle from head (dark) to tail (bright)."""
    with figure(path, 11.0, height=2.1 * len(found) + 0.4) as canvas:
        for axes, p in zip(np.atleast_1d(canvas.subplots(len(found), 1)), found, strict=True):
            for speed, valid, colour in zip(p.speed, p.valid, shades(len(p.vehicles)), strict=True):
                axes.plot(p.time - p.time[0], np.where(valid, speed, np.nan), color=colour, lw=0.9)
            if p.moving:
                axes.axvspan(p.moving.start - p.time[0], p.moving.end - p.time[0], color="#f0f0f0", lw=0)
            axes.set(title=f"{p.name}: {len(p.vehicles)} vehicles", ylabel="m/s")
            axes.margins(x=0)
        canvas.axes[-1].set_xlabel("time [s] (grey: all drive)")


def draw_summary(found: list[Platoon], path: Path) -> None:
    """Deviation down the platoon, gains with intervals, transfer by frequency, time gaps, flow over density."""
    colours = shades(len(found) + 1)[: len(found)]
    with figure(path, 11.0, height=6.6) as canvas:
        (a, b, c), (d, e, f) = canvas.subplots(2, 3)
        for p, colour in zip(found, colours, strict=True):
            a.plot(range(1, len(p.spread) + 1), p.spread, "o-", color=colour, ms=3.5, label=p.name)
            use = p.spectra.segments > 1
            if use.any():
                gain = np.median(p.spectra.gain[use], axis=0)
                c.plot(p.spectra.frequency[1:], gain[1:], color=colour)
            gaps = p.headway[1:][p.valid[1:] & np.isfinite(p.headway[1:]) & (p.speed[1:] > 2)]
            d.hist(gaps, np.linspace(0, 6, 61), density=True, histtype="step", color=colour)
            close = np.isfinite(p.ttc[1:]) & p.valid[1:]
            e.hist(
                np.clip(1 / np.maximum(p.ttc[1:][close], 0.1), 0, 1),
                np.linspace(0, 1, 61),
                histtype="step",
                color=colour,
            )
            f.plot(p.density, p.flow, "o", color=colour, ms=3, alpha=0.6)
        rows = [
            (p, gain, at)
            for k, p in enumerate(found)
            for gain, at in ((p.whole, k - 0.12), (p.moving, k + 0.12))
            if gain
        ]
        for p, gain, at in rows:
            colour = BAD if gain.low > 1 else GOOD if gain.high < 1 else "#555555"
            b.plot([gain.low, gain.high], [at, at], color=colour, lw=1.2)
            b.plot(gain.ratio, at, "o" if gain is p.whole else "s", color=colour, ms=5)
        b.axvline(1, color=LINE, lw=0.8)
        b.set_yticks(range(len(found)), [p.name.replace(" ", "\n") for p in found], fontsize=7)
        b.set(xscale="log", title="b  gain, head to tail", xlabel="circle: whole, square: all moving")
        b.invert_yaxis()
        a.set(title="a  deviation of speed [m/s]", xlabel="place in the platoon")
        c.legend(*a.get_legend_handles_labels(), fontsize=7, loc="upper right")
        c.axhline(1, color=LINE, lw=0.8)
        c.set(
            title="c  median |H| from the vehicle ahead",
            xlabel="frequency [Hz]",
            xscale="log",
            ylim=(0, 2.5),
            xlim=(0.03, 1),
        )
        d.set(title="d  time gap above 2 m/s [s], density")
        e.set(title="e  1 / TTC [1/s], samples closing in")
        if any((np.isfinite(p.ttc[1:]) & p.valid[1:]).any() for p in found):
            e.set_yscale("log")
        f.set(title="f  fundamental diagram (Edie)", xlabel="vehicles/km", ylabel="vehicles/h")
