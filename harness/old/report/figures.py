"""All functions that draw into axes, for a user's notebooks and pages."""

from harness.old.report.drawing.episode_figures import (
    draw_arrivals as draw_arrivals,
    draw_speed_over_distance as draw_speed_over_distance,
    draw_speed_over_time as draw_speed_over_time,
)
from harness.old.report.drawing.model_figures import (
    draw_bic as draw_bic,
    draw_bic_gain as draw_bic_gain,
    draw_driving_speed as draw_driving_speed,
    draw_held_out as draw_held_out,
    draw_pair as draw_pair,
    draw_rows as draw_rows,
    draw_walking_speed as draw_walking_speed,
)
from harness.old.report.drawing.safety_figures import (
    draw_shares as draw_shares,
    draw_walking_speeds as draw_walking_speeds,
)
from harness.old.report.drawing.site_figures import draw_site as draw_site
from harness.old.report.drawing.sweep_figures import (
    draw_aggressiveness as draw_aggressiveness,
    draw_over as draw_over,
)
from harness.old.report.drawing.tau_figures import (
    draw_running_mean as draw_running_mean,
    draw_tau_distribution as draw_tau_distribution,
)
from harness.old.report.drawing.trajectory_figures import (
    draw_map as draw_map,
    draw_passing_event as draw_passing_event,
)
