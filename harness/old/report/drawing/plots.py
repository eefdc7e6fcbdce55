"""Writes the figures of ``extract --plots`` and ``model show --plots`` to files."""

import io
import re
from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from harness.core.files import cannot_write, write_file
from harness.model.interaction import InteractionModel
from harness.model.trajectories import Clip
from harness.old.report.drawing import model_figures as draw
from harness.old.report.drawing.style import caption, new_figure, without_glyph_warnings
from harness.old.report.drawing.trajectory_figures import draw_map, draw_passing_event
from harness.old.studies.calibration import Sample
from harness.old.studies.calibration.choice import RULE_SHARE, relative_gain

# The authors' public scripts draw these conditions.
_INVERSE_RANGES = (0.07, 0.10, 0.13)
_INVERSE_TIMES = (0.05, 0.10)
# This is below the speed at the trigger in the paper's Table II.
_VEHICLE_SPEEDS = (2.0, 3.5, 5.0)


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write ``name.png`` and ``name.pdf`` without time stamps; a failure leaves no partial file."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from None
    written = []
    for suffix, metadata in ((".png", {"Software": None}), (".pdf", {"CreationDate": None})):
        buffer = io.BytesIO()
        with without_glyph_warnings():
            figure.savefig(
                buffer, format=suffix[1:], dpi=150, bbox_inches="tight", metadata=metadata
            )
        written.append(folder / f"{name}{suffix}")
        write_file(written[-1], buffer.getvalue())
    return written


def plot_trajectories(clips: Sequence[Clip], rows: pd.DataFrame, folder: Path) -> list[Path]:
    """Write a map of each site and one passing event coloured by time; replace earlier files."""
    written = []
    by_site = attrgetter("site")
    for site, clips_there in groupby(sorted(clips, key=by_site), key=by_site):
        figure, axes = new_figure(height=6, width=8)
        title = f"{site}: vehicle routes and pedestrian positions" if site else None
        draw_map(axes[0], list(clips_there), title)
        # The name of a clip in a subfolder begins with the subfolder, as in "b/straight".
        name = "-".join(["map", *re.findall(r"[\w.]+", site)])
        written += save(figure, folder, name)
    # This is the encounter with the vehicle's longest recorded approach.
    ranges = rows.groupby(["source", "clip", "vehicle", "pedestrian"])["range_m"]
    spans = ranges.max() - ranges.min()
    source, name, vehicle, pedestrian = (str(part) for part in spans.index[int(spans.argmax())])
    figure, axes = new_figure(height=6, width=8)
    clip = next(clip for clip in clips if (clip.source, clip.name) == (source, name))
    draw_passing_event(axes[0], clip, vehicle, pedestrian)
    return [*written, *save(figure, folder, "passing-event")]


def plot_model(model: InteractionModel, sample: Sample | None, folder: Path) -> list[Path]:
    """Write the paper's figures of a model next to a sample's rows; replace earlier files."""
    written = []
    if len(model.provenance.get("candidates", ())) > 1:
        written += save(_components_page(model), folder, "components")
    written += save(_pairs_page(model, sample), folder, "pairs")
    return [*written, *save(_speeds_page(model), folder, "speeds")]


def _components_page(model: InteractionModel) -> Figure:
    """Return a figure with BIC, each component's gain, and held-out scores."""
    card = model.provenance
    bic = {fit["components"]: fit["bic"] for fit in card["candidates"]}
    held_out = {fit["components"]: fit["held_out"] for fit in card["candidates"]}
    scores = {k: (score["mean"], score["standard_error"]) for k, score in held_out.items() if score}
    figure, axes = new_figure(1, 3 if scores else 2, height=4, width=15 if scores else 10)
    draw.draw_bic(axes[0], bic, card["components"])
    draw.draw_bic_gain(axes[1], relative_gain(bic), RULE_SHARE)
    if scores:
        draw.draw_held_out(axes[2], scores, card["components"])
    caption(
        figure,
        f"{model.name}: n = {card['rows']:,} rows, {card['encounters']} encounters, "
        f"{card['vehicles']} vehicles; BIC's n is {card['weight_sum']:.0f}. "
        "Bars: standard error over vehicles.",
    )
    return figure


def _pairs_page(model: InteractionModel, sample: Sample | None) -> Figure:
    """Return a figure of all six pairs of variables; rows and model have the same scale."""
    across, width = (4, 15) if sample is not None else (2, 8)
    figure, axes = new_figure(3, across, height=10.5, width=width)
    view = draw.usual_view(model.mixture)
    panels = iter(axes)
    for pair in draw.PAIRS:
        density = draw.pair_density(model.mixture, pair, view)
        norm = draw.density_scale(density)
        if sample is not None:
            draw.draw_rows(next(panels), sample.data, sample.weights, pair, view, norm)
        panel = next(panels)
        mesh = draw.draw_pair(panel, density, pair, view, norm)
        figure.colorbar(mesh, ax=panel, label="density")
    rows = "" if sample is None else f"; {len(sample.data):,} rows weighted by {sample.weigh}"
    words = f"K = {model.mixture.weights.size}; one colour scale per pair (square root){rows}"
    caption(figure, f"{model.name}, {words}.")
    return figure


def _speeds_page(model: InteractionModel) -> Figure:
    """Return a figure of v_p and v under the authors' conditions, and of v_p as in a run."""
    figure, axes = new_figure(2, 2, height=8.5, width=12)
    ranges = [{"range_m": 1 / inverse} for inverse in _INVERSE_RANGES]
    common: dict[str, float] = {"vehicle_speed_mps": 3.5, "inverse_time_advantage_per_s": 0.1}
    draw.draw_walking_speed(axes[0], model, [each | common for each in ranges], "v_p")
    at_trigger = [{"range_m": 30.0, "vehicle_speed_mps": speed} for speed in _VEHICLE_SPEEDS]
    draw.draw_walking_speed(axes[1], model, at_trigger, "v_p, T_adv integrated out,")
    for panel, inverse_time in zip(axes[2:], _INVERSE_TIMES, strict=True):
        common = {"pedestrian_speed_mps": 1.2, "inverse_time_advantage_per_s": inverse_time}
        draw.draw_driving_speed(panel, model, [each | common for each in ranges], "v")
    rows = model.provenance.get("rows")
    words = f"{model.name}, K = {model.mixture.weights.size}"
    words += f", fitted on n = {rows:,} rows" if isinstance(rows, int) else ""
    caption(figure, words + ". Dots are the modes, the speeds that the human driver aims for.")
    return figure
