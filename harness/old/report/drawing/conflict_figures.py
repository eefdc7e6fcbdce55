"""Histograms of the conflicts of a recording."""

import numpy as np

from harness.old.report.drawing import style
from harness.old.report.drawing.style import Picture
from harness.old.studies.conflicts import ConflictFindings

_UP_TO_S = 5.0
_BIN_S = 0.25


def conflict_pictures(findings: ConflictFindings) -> list[Picture]:
    """Return histograms of the passages' PET and TTC."""
    met = [each.record for each in findings.passages if each.record.pedestrians]
    figure, panels = style.new_figure(2, height=1.5 * style.HEIGHT_INCH)
    limits = findings.thresholds
    for axes, name, title, limit in zip(
        panels, ("pet_s", "min_ttc_s"), ("PET", "smallest TTC"), (limits.pet_s, limits.ttc_s),
        strict=True,
    ):  # fmt: skip
        values = np.array([value for each in met if (value := getattr(each, name)) is not None])
        inside = values[values <= _UP_TO_S]
        edges = np.arange(0.0, _UP_TO_S + _BIN_S, _BIN_S)
        axes.hist(inside, edges.tolist(), color=style.BLUE, ec=style.INK, lw=0.5)
        axes.axvline(limit, color=style.VERMILLION, ls="--", lw=1.4, label=f"{limit:g} s")
        axes.set_xlim(0, _UP_TO_S)
        count = f"{len(inside):,} of {len(met):,} passages with people"
        style.finish(axes, f"{title} (s)", "passages", count)
    caption = (
        "Passages with people on the crosswalk. A PET or TTC above 5 s, or none, is not drawn; the "
        "dashed line is the threshold of a conflict. A contact has TTC 0 and no PET."
    )
    return [Picture("pet-ttc", "PET and TTC", caption, figure)]
