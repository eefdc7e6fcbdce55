"""Every function that draws into axes, for notebooks and pages of one's own."""

from harness.report.drawing.episode_figures import (
    draw_arrivals,
    draw_speed_over_distance,
    draw_speed_over_time,
)
from harness.report.drawing.model_figures import (
    draw_bic,
    draw_bic_gain,
    draw_driving_speed,
    draw_held_out,
    draw_pair,
    draw_rows,
    draw_walking_speed,
)
from harness.report.drawing.safety_figures import draw_shares, draw_walking_speeds
from harness.report.drawing.site_figures import draw_site
from harness.report.drawing.sweep_figures import draw_aggressiveness, draw_over
from harness.report.drawing.tau_figures import draw_running_mean, draw_tau_distribution
from harness.report.drawing.trajectory_figures import draw_map, draw_passing_event

__all__ = [
    "draw_aggressiveness",
    "draw_arrivals",
    "draw_bic",
    "draw_bic_gain",
    "draw_driving_speed",
    "draw_held_out",
    "draw_map",
    "draw_over",
    "draw_pair",
    "draw_passing_event",
    "draw_rows",
    "draw_running_mean",
    "draw_shares",
    "draw_site",
    "draw_speed_over_distance",
    "draw_speed_over_time",
    "draw_tau_distribution",
    "draw_walking_speed",
    "draw_walking_speeds",
]
