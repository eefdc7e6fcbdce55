"""View settings of sumo-gui: the ego is coloured by speed, and pedestrians are enlarged."""

from xml.sax.saxutils import quoteattr

PEDESTRIAN_EXAGGERATION = 4
"""Factor by which pedestrians are drawn larger than they are."""

_BY_SPEED, _BY_TYPE = 8, 0
_UNIFORM = 1
"""Indices of sumo-gui's colouring schemes of vehicles and of persons."""


def view_settings(delay_ms: float, initial_speed_mps: float | None = None) -> str:
    """A settings file for ``--gui-settings-file``.

    Args:
        delay_ms: pause after each step.
        initial_speed_mps: v0; the ego is blue at this speed and red at standstill.  None: vehicles
            have the colour of their type, which distinguishes AVs from other vehicles.
    """
    if initial_speed_mps is None:
        return _settings(delay_ms, f'vehicleMode="{_BY_TYPE}"', "")
    colours = (("215,48,39", 0.0), ("254,224,144", 0.5), ("69,117,180", 1.0))
    speeds = "".join(
        f'<entry color="{colour}" threshold={quoteattr(f"{share * initial_speed_mps:.6g}")}/>'
        for colour, share in colours
    )
    scheme = f'<colorScheme name="by speed" interpolated="1">{speeds}</colorScheme>'
    return _settings(delay_ms, f'vehicleMode="{_BY_SPEED}"', scheme)


def _settings(delay_ms: float, vehicle_mode: str, vehicle_colours: str) -> str:
    return f"""<viewsettings>
    <scheme name="crosswalk">
        <background backgroundColor="236,236,230" showGrid="0"/>
        <edges laneEdgeMode="0" laneShowBorders="1" showLinkDecals="1">
            <colorScheme name="uniform">
                <entry color="110,110,110" name="road"/>
                <entry color="180,180,180" name="sidewalk"/>
            </colorScheme>
        </edges>
        <vehicles {vehicle_mode} vehicleQuality="2" vehicle_exaggeration="1">
            {vehicle_colours}
        </vehicles>
        <persons personMode="{_UNIFORM}" personQuality="2"
                 person_exaggeration="{PEDESTRIAN_EXAGGERATION}">
            <colorScheme name="uniform"><entry color="197,27,125"/></colorScheme>
        </persons>
        <junctions junctionMode="0" drawCrossingsAndWalkingareas="1">
            <colorScheme name="uniform"><entry color="110,110,110"/></colorScheme>
        </junctions>
    </scheme>
    <viewport x="0" y="0" zoom="1200"/>
    <delay value="{delay_ms:.6g}"/>
</viewsettings>
"""
