"""The figure of people beside measured people: simulated over measured numbers."""

import numpy as np

from harness.report.drawing import style
from harness.studies.validation.people import PeopleFindings


def pictures_of(findings: PeopleFindings) -> list[style.Picture]:
    """Return the page's figure.  Call this inside ``style.styled``."""
    shown = [held for held in findings.held if held.scores is not None]
    titles = list(dict.fromkeys(held.experiment.title for held in shown))
    figure, panels = style.new_figure(len(titles), height=3.4 * len(titles))
    for panel, title in zip(panels, titles, strict=True):
        drivers = [held for held in shown if held.experiment.title == title]
        for held, look in zip(drivers, style.SERIES, strict=False):
            numbers = [(row.measured, row.simulated, row.standard_error) for row in held.rows]
            across, up, error = np.array(numbers, dtype=float).T
            name = style.figure_text(held.driver) or None
            panel.errorbar(across, up, error, fmt=look.marker, color=look.colour, label=name)
        panel.axline((0, 0), slope=1, color=style.MUTED, ls=":")
        panel.set_title(title, loc="left")
        unit = "s" if drivers[0].rows[0].number else "share"
        style.finish(panel, f"measured ({unit})", f"simulated ({unit})")
    caption = "On the dotted line they are equal. Bars are one standard error of the simulation."
    return [style.Picture("people", "Simulated over measured numbers", caption, figure)]
