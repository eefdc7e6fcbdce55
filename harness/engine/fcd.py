"""SUMO's FCD output, record by record: XML or CSV, plain or packed by gzip."""

import csv
import gzip
import math
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from harness.core.errors import InputError
from harness.engine.configuration import elements_of, seconds
from harness.engine.session import Session

FORMATS = "SUMO's --fcd-output or --person-fcd-output: .xml, .xml.gz, .csv or .csv.gz"

Record = Mapping[str, Any]
"""The attributes of a vehicle or a person at one time, as SUMO names them."""


def records(path: Path) -> Iterator[tuple[float, Record]]:
    """Every record of a file, with its time in s; the file is never read whole.

    Raises:
        InputError: the file is missing, cut off, or no FCD.
    """
    if not path.is_file():
        raise InputError(str(path), "no such file", FORMATS)
    try:
        with gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb") as file:
            of_csv = path.name.removesuffix(".gz").endswith(".csv")
            yield from _of_csv(file) if of_csv else _of_xml(file)
    except (ET.ParseError, EOFError, zlib.error, OSError) as error:
        raise InputError(str(path), f"is cut off, or no FCD ({error})", FORMATS) from None
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(str(path), f"is damaged, or no FCD ({error})", FORMATS) from None


def _of_csv(file: Any) -> Iterator[tuple[float, Record]]:
    lines = (line.decode() for line in file)
    head = next(lines, "")
    names = head.strip().split(separator := ";" if ";" in head else ",")
    for row in csv.DictReader(lines, names, delimiter=separator):
        for kind in ("vehicle_", "person_"):
            # A time without vehicles has a row without an id.
            if row.get(f"{kind}id"):
                time_s = seconds(row["timestep_time"])
                yield time_s, {name.removeprefix(kind): of for name, of in row.items()}


def _of_xml(file: Any) -> Iterator[tuple[float, Record]]:
    events = ET.iterparse(file, ("start", "end"))
    root, time_s = next(events)[1], math.nan
    if root.tag != "fcd-export":
        raise ValueError(f"its first element is <{root.tag[:40]}>")
    for event, element in events:
        if event == "start":
            if element.tag == "timestep":
                time_s = seconds(element.attrib["time"])
        elif element.tag in ("vehicle", "person"):
            yield time_s, element.attrib
        elif element.tag == "timestep":
            root.clear()


def sizes_of(net: Path, files: Sequence[Path]) -> Mapping[str, Sequence[float]]:
    """What FCD lacks: each vehicle type as SUMO reads it from these files, and SUMO's own ones.

    That is length, width, acceleration, deceleration and top speed, in m and s.

    Raises:
        InputError: a file defines no type.
        EngineError: SUMO refuses one.
    """
    root = ET.Element("additional")
    for file in files:
        own = [each.attrib for each in elements_of(file) if each.tag == "vType"]
        if not own:
            allowed = "an additional or route file with vType elements"
            raise InputError(str(file), "defines no vehicle type", allowed)
        for attributes in own:
            ET.SubElement(root, "vType", attributes)
    with TemporaryDirectory() as folder:
        types, config = Path(folder, "types.xml"), Path(folder, "types.sumocfg")
        ET.ElementTree(root).write(types)
        config.write_text('<configuration><no-step-log value="true"/></configuration>')
        options = {"net-file": str(net), "additional-files": str(types)}
        session = Session(config, options)
        try:
            return session.vehicle_types()
        finally:
            session.close()
