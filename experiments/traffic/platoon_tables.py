"""What platoons came to, as tables and numbers."""

from typing import Any

import numpy as np

from experiments.traffic.platoon import Gain, Platoon
from urbanjax.traffic.flow import transfer

SHORT = ("platoon", "gain, whole", "interval", "gain, all moving", "interval ")  # columns that fit a terminal


def table(found: list[Platoon]) -> dict[str, list[Any]]:
    """One row per platoon."""
    rows: dict[str, list[Any]] = {}
    for p in found:
        close = p.valid[1:] & np.isfinite(p.headway[1:])
        row = {
            "platoon": p.name,
            "vehicles": len(p.vehicles),
            "duration [s]": float(p.time[-1] - p.time[0]),
            "speed deviation, head [m/s]": float(p.spread[0]),
            "tail [m/s]": float(p.spread[-1]),
            "gain, whole": p.whole.ratio,
            "interval": _text(p.whole),
            "of peaks": p.whole.peaks,
            "gain, all moving": p.moving.ratio if p.moving else None,
            "interval ": _text(p.moving),
            "time gap, median [s]": float(np.median(p.headway[1:][close])) if close.any() else None,
            "least TTC [s]": _finite(p.ttc.min()),
            "greatest DRAC [m/s^2]": _finite(p.deceleration.max()),
            "TET [s]": float(p.exposed.sum()),
        }
        for name, value in row.items():
            rows.setdefault(name, []).append(value)
    return rows


def _finite(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def _text(gain: Gain | None) -> str:
    return f"[{gain.low:.2f}, {gain.high:.2f}] in {gain.end - gain.start:.0f} s" if gain else "-"


def vehicle_table(found: list[Platoon]) -> dict[str, list[Any]]:
    """One row per vehicle."""
    rows: dict[str, list[Any]] = {}
    for p in found:
        peak, at, some = (np.asarray(x) for x in transfer.worst(p.spectra, 0.01, high=0.5))
        for v, vehicle in enumerate(p.vehicles):
            gaps = p.headway[v][p.valid[v] & np.isfinite(p.headway[v])] if v else np.array([])
            row = {
                "platoon": p.name,
                "vehicle": vehicle,
                "speed deviation [m/s]": float(p.spread[v]),
                "largest gain |H|": float(peak[v]) if some[v] else None,
                "at [Hz]": float(at[v]) if some[v] else None,
                "time gap, median [s]": float(np.median(gaps)) if len(gaps) else None,
                "least TTC [s]": _finite(p.ttc[v].min()) if v else None,
                "TET [s]": float(p.exposed[v]),
                "TIT [s^2]": float(p.integrated[v]),
            }
            for name, value in row.items():
                rows.setdefault(name, []).append(value)
    return rows


def summary(found: list[Platoon]) -> dict[str, float]:
    """Flat numbers by name."""
    numbers = {}
    for p in found:
        name = p.name.replace(" ", "_")
        numbers[f"{name}_head_deviation_mps"] = float(p.spread[0])
        numbers[f"{name}_tail_deviation_mps"] = float(p.spread[-1])
        for stretch, gain in (("whole", p.whole), ("moving", p.moving)):
            if gain:
                numbers[f"{name}_gain_{stretch}"] = gain.ratio
                numbers[f"{name}_gain_of_peaks_{stretch}"] = gain.peaks
                numbers[f"{name}_gain_{stretch}_low"] = gain.low
                numbers[f"{name}_gain_{stretch}_high"] = gain.high
    return numbers
