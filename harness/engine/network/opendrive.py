"""A SUMO network in; the same road as OpenDRIVE out."""

import re
import tempfile
from pathlib import Path

from harness.engine.network.build import run_netconvert

_DATE = re.compile(r'(<header\b[^>]*?) date="[^"]*"')


def opendrive(net: Path) -> bytes:
    """A network as OpenDRIVE, in the network's own coordinates.

    The same network gives the same bytes, because netconvert's comment and its date are removed.

    Raises:
        EngineError: netconvert is missing or failed.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as temporary:
        path = Path(temporary) / "road.xodr"
        # The default precision of 1 cm would shift and turn the lanes.
        arguments = ["--sumo-net-file", str(net.absolute()), "--opendrive-output", path.name]
        run_netconvert([*arguments, "--precision", "9"], path.parent)
        text = path.read_text(encoding="utf-8")
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    return _DATE.sub(r"\1", text, count=1).encode()
