"""What all arms of a cell share: a scenario whose simulation has been read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from harness.core.errors import StrategyError, in_one_line
from harness.core.freezing import Frozen
from harness.core.seeding import number_of, sumo_seed
from harness.core.vocabulary import Arm, Arrival, Strategy, Vehicle
from harness.encounter.arms import make_strategy
from harness.encounter.arrivals import planned_arrivals
from harness.engine.configuration import SumoConfig
from harness.engine.protocol import VehicleType
from harness.engine.sources import CROSSWALK
from harness.model.interaction import InteractionModel
from harness.scenario import Scenario
from harness.scenario.sections import SUMO_DRIVER, SimulationSection
from harness.site.town import Crosswalk, Town


@dataclass(frozen=True, slots=True)
class Setup(Frozen):
    """A scenario whose simulation has been read.

    Attributes:
        scenario: the scenario, with the simulation's step.
        model: the interaction model.
        config: SUMO's configuration.
        town: its network.
        crosswalks: the chosen crosswalks by their ids.
        simulation: says which vehicles are AVs.
        begin_s, end_s: the counted time; the end may be infinite.
    """

    scenario: Scenario
    model: InteractionModel
    config: SumoConfig
    town: Town
    crosswalks: Mapping[str, Crosswalk]
    simulation: SimulationSection
    begin_s: float
    end_s: float

    @property
    def own_people(self) -> bool:
        """Whether people of the harness come."""
        return self.scenario.pedestrians.anyone_comes

    def counts(self, time_s: float) -> bool:
        """Whether a time is within the counted time."""
        return self.begin_s <= time_s < self.end_s

    def seed(self, pair: int) -> int:
        """SUMO's seed of a pair."""
        # That of ``[traffic]`` has been written for its pair.
        if self.scenario.traffic is not None:
            return self.config.seed
        return sumo_seed(self.scenario.experiment.seed, self.config.seed, pair)

    def vehicle(self, kind: VehicleType, driver: Arm | None = None) -> Vehicle:
        """The constants of a vehicle, as late as its driver's; v0 and R0 are those of a passage."""
        ego = self.scenario.vehicle(driver)
        return replace(
            ego,
            length_m=kind.length_m,
            width_m=kind.width_m,
            max_acceleration_mps2=kind.acceleration_mps2,
            max_deceleration_mps2=kind.deceleration_mps2,
            resume_acceleration_mps2=min(ego.resume_acceleration_mps2, kind.acceleration_mps2),
        )

    def strategy(self, driver: Arm, pair: int, vehicle: str) -> Strategy | None:
        """The strategy of a vehicle; None if SUMO is the driver.

        Raises:
            StrategyError: it cannot be made.
        """
        if self.scenario.arms.driver(driver) == SUMO_DRIVER:
            return None
        try:
            return make_strategy(self.scenario, driver, pair, self.model, number_of(vehicle))
        except (Exception, SystemExit) as error:
            what = f"vehicle {vehicle}: the strategy could not be made: {in_one_line(error)}"
            raise StrategyError(what, error) from None

    def arrivals(self, pair: int, crosswalk: str) -> Sequence[Arrival]:
        """The harness's people at a crosswalk, by SUMO's time.

        In the harness's own network they have the streams of an encounter's.
        """
        since_s, last_s = self.config.begin_s, self.config.end_s
        horizon_s = (self.end_s if last_s is None else last_s) - since_s
        # People of the near side come from the begin of the axis: here it is at the far kerb.
        scenario = self.scenario.mirrored() if crosswalk == CROSSWALK else self.scenario
        key = () if crosswalk == CROSSWALK else (number_of(crosswalk),)
        planned = planned_arrivals(scenario, pair, horizon_s=horizon_s, key=key)
        return [each._replace(arrival_s=since_s + each.arrival_s) for each in planned]
