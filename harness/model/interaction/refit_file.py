"""Reads and writes the refits of a model: a JSON file beside the model's (see docs/files.md)."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.core.documents import check_form, parse_json
from harness.core.errors import InputError
from harness.core.files import read_file, write_file
from harness.model.interaction.model import VARIABLES, InteractionModel, Refits
from harness.model.mixture.distribution import TruncatedGaussianMixture

FEWEST_REFITS = 5
"""Fewer refits say too little about the spread between them."""

_ENDING = ".refits.json"
_DIGITS = 10
"""Significant digits of the parameters in the file, far more than a fit has."""

_Number = Annotated[float, Field(ge=-1e9, le=1e9)]
_TRIANGLE = np.tril_indices(len(VARIABLES))


class Refit(BaseModel):
    """One refit: weights (K,), locations (K, 4), lower triangles of the scale matrices (K, 10)."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    weights: list[_Number]
    locations: list[list[_Number]]
    scale_triangles: list[Annotated[list[_Number], Field(min_length=10, max_length=10)]]

    @classmethod
    def of(cls, mixture: TruncatedGaussianMixture) -> "Refit":
        """The parameters of a mixture, rounded to the digits of the file."""
        triangles = mixture.scale_matrices[:, _TRIANGLE[0], _TRIANGLE[1]]
        return cls(
            weights=[_rounded(weight) for weight in mixture.weights],
            locations=[[_rounded(x) for x in row] for row in mixture.locations],
            scale_triangles=[[_rounded(x) for x in row] for row in triangles],
        )

    def mixture(self, lower: np.ndarray, upper: np.ndarray) -> TruncatedGaussianMixture:
        """The mixture with these parameters in a box."""
        scales = np.empty((len(self.scale_triangles), len(VARIABLES), len(VARIABLES)))
        scales[:, _TRIANGLE[0], _TRIANGLE[1]] = self.scale_triangles
        scales[:, _TRIANGLE[1], _TRIANGLE[0]] = self.scale_triangles
        weights, locations = np.array(self.weights), np.array(self.locations)
        return TruncatedGaussianMixture(weights, locations, scales, lower, upper)


class RefitFile(BaseModel):
    """The refits of one model; while they are being made, some of them are missing.

    Attributes:
        format_version: the version of the file's form.
        model_sha256: hash of the model's file.
        rows_sha256: hash of the file of rows.
        seed: seed of the draws of vehicles and of the starts.
        starts: number of starts of each refit.
        vehicles: number of vehicles in the data.
        drawn_vehicles: number of vehicles that each refit draws with replacement.
        effective_vehicles: Kish's effective number of vehicles.
        wanted: number of refits of the finished file.
        refits: the finished refits by number.
    """

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    format_version: Literal[1] = Field(alias="schema", default=1)
    model_sha256: str
    rows_sha256: str
    seed: int
    starts: int
    vehicles: int
    drawn_vehicles: int
    effective_vehicles: Annotated[float, Field(ge=1)]
    wanted: Annotated[int, Field(ge=FEWEST_REFITS)]
    refits: Mapping[str, Refit] = {}

    def same_recipe(self, other: "RefitFile") -> bool:
        """Whether both files have refits of the same model, made in the same way."""
        free = {"wanted", "refits"}
        return self.model_dump(exclude=free) == other.model_dump(exclude=free)

    def content(self) -> bytes:
        """The file's bytes; they do not depend on the order in which the refits were made."""
        document = self.model_dump(by_alias=True)
        refits = document.pop("refits")
        # A line for each refit.
        lines = ",\n".join(f'  "{number}": {json.dumps(refits[number])}' for number in self.numbers)
        head = json.dumps(document, indent=1).removesuffix("\n}")
        return f'{head},\n "refits": {{\n{lines}\n }}\n}}\n'.encode()

    @property
    def numbers(self) -> list[str]:
        """The numbers of the finished refits, ascending."""
        return sorted(self.refits, key=int)

    def refits_of(self, model: InteractionModel, where: str) -> Refits:
        """The refits as models.

        Raises:
            InputError: a refit is missing or is not a valid mixture.
        """
        if self.numbers != [str(number) for number in range(self.wanted)]:
            problem = f"has {len(self.refits)} of {self.wanted} refits"
            raise InputError(where, problem, "all of them: the same `harness fit` continues")
        lower, upper = model.mixture.lower, model.mixture.upper
        try:
            mixtures = [self.refits[number].mixture(lower, upper) for number in self.numbers]
        except InputError as error:
            raise InputError(where, str(error)) from None
        except ValueError:
            raise InputError(where, "has locations of wrong shapes", "4 numbers each") from None
        models = [
            InteractionModel(mixture, f"{model.name}, refit {number}", {}, "")
            for number, mixture in enumerate(mixtures)
        ]
        digest = hashlib.sha256(self.content()).hexdigest()
        return Refits(tuple(models), self.effective_vehicles, digest)


def refits_beside(model: Path) -> Path:
    """The file of the refits of a model's file.

    >>> refits_beside(Path("models/campus.json")).name
    'campus.refits.json'
    """
    return model.with_name(model.stem + _ENDING)


def is_refit_file(path: Path) -> bool:
    """Whether a file's name is that of a file of refits."""
    return path.name.endswith(_ENDING)


def read_refits(path: Path, model: InteractionModel) -> RefitFile:
    """Read the file of a model's refits.

    Raises:
        InputError: there is no such file, it is not valid, or it belongs to another model.
    """
    if not path.is_file():
        allowed = "a model with refits: `harness fit … --refits 20`"
        raise InputError(str(path), f"is missing, so model {model.name} has no refits", allowed)
    try:
        document = parse_json(read_file(path))
    except ValueError as error:
        raise InputError(str(path), f"not a JSON file ({error})", "a file of refits") from None
    file = check_form(RefitFile, document, str(path))
    if file.model_sha256 != model.sha256:
        problem = f"has the refits of another model (sha256 {file.model_sha256[:8]}…)"
        raise InputError(str(path), problem, f"refits of sha256 {model.sha256[:8]}…")
    return file


def write_refits(path: Path, file: RefitFile) -> None:
    """Write the file whole; an existing one is replaced."""
    write_file(path, file.content())


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
