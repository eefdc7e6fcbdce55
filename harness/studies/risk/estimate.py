"""The probability of a rare event in an episode: a folder of draws, and what it says.

The last round of ``draws`` is the estimate.  ``events`` is a run of a sample of its events by their
weights: what an episode with the event looks like, with both drivers.
"""

import json
import shlex
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from scipy import special
from threadpoolctl import threadpool_limits

from harness.core.errors import InputError, Parameter, advised
from harness.core.seeding import resampling
from harness.core.vocabulary import Arm, Ending, Progress, Trace, ignore
from harness.encounter.loop import Episode
from harness.encounter.pairing import PairRunner
from harness.engine.shared import open_engine
from harness.measures import Outcome, measure
from harness.model.mixture.normals import effective
from harness.results import folder as folders, tables
from harness.results.catalogue import entries_of
from harness.results.cell_findings import CellFindings
from harness.results.finding import Finding, Findings
from harness.results.loaded_run import older_code
from harness.results.notes import Note, retries
from harness.results.place import place_in_words
from harness.results.references import not_validated
from harness.results.result import Column, Result, Shown, Table
from harness.scenario import Cell, EngineName, Study, validate
from harness.scenario.study import study_from
from harness.studies.risk import draws as risk_draws
from harness.studies.risk.draws import DrawInputs, DrawOutcome, Proposal, Units
from harness.studies.risk.learning import rounds_of
from harness.studies.risk.space import Event, Space, parse_event, space_of
from harness.studies.running import claimed_folder, run as runs
from harness.studies.running.tasks import EpisodeId, Task, TaskRows, Tell, part_pairs

_TABLE = tables.DRAWS.name

MOST_DRAWS = 200_000
"""Most draws of an estimate."""

_SHOWN = 50
"""Most events of which a run is made."""

_SMALL_SAMPLE = 30
"""Effective number of draws below which an interval is unreliable."""

_LARGE_SHARE = 0.1
"""An interval is unreliable if one draw holds more than this share of the estimate."""

_CHECK_TAIL = 0.001
"""An interval is unreliable if nominal draws agree with it with less than this tail probability."""


@dataclass(frozen=True)
class _Drawing:
    """Draws the units of tasks in a worker."""

    space: Space
    event: Event
    proposal: Proposal

    def run(self, task: Task, tell: Tell) -> TaskRows:
        """The rows of a task; units of which an episode was given up are recorded as failed."""
        (cell,), (arm,) = task.cells, task.arms
        scenario = cell.scenario
        runner = PairRunner(scenario, task.model, lambda: open_engine(scenario, task.engine))
        lost = {
            each.pair: DrawOutcome(event=False, reason=why.reason)
            for each, why in task.given_up.items()
        }

        def run(episodes: Sequence[DrawInputs]) -> list[DrawOutcome]:
            kept = [each for each in episodes if each.unit not in lost]
            inputs = [(each.number, each.given(self.space)) for each in kept]
            unit_of = {each.number: each.unit for each in kept}

            def begins(number: int, _arm: Arm, episode: Episode) -> None:
                tell(EpisodeId(cell.number, unit_of[number], arm), episode.x_m)

            measured = [*runner.run_arm_given(arm, inputs, lambda: tell(None, None), begins)]
            found = self._outcomes(kept, measured)
            return [lost.get(each.unit) or next(found) for each in episodes]

        with threadpool_limits(1, user_api="blas"):
            rows = risk_draws.draw_units(self.proposal, self.space, cell.number, task.pairs, run)
        return TaskRows({cell.number: {_TABLE: tables.DRAWS.of(rows)}})

    def _outcomes(
        self, drawn: Sequence[DrawInputs], measured: Sequence[Outcome]
    ) -> Iterator[DrawOutcome]:
        """Yield what each draw's episode came to; scores are of whom it asks for alone."""
        before = self.space.before
        traces = []
        for at, each in zip(drawn, measured, strict=True):
            alone = (w for w in each.trace.walks if at.place(w.arrival.index - before) == at.asked)
            traces.append(replace(each.trace, walks=tuple(alone)))
        for at, each, own in zip(drawn, measured, measure(traces), strict=True):
            event = self.event.holds(each.record)
            culprit = self._culprit(each) if event else None
            given = at.given(self.space) if event else {}
            yield DrawOutcome(
                event,
                None if culprit is None else at.place(culprit - before),
                self.event.scores(own),
                *_passage(each.trace),
                each.record.reason,
                each.record.ending is Ending.TIMED_OUT,
                json.dumps({"episode": at.number, "uniforms": given}) if event else None,
            )

    def _culprit(self, measured: Outcome) -> int | None:
        """The index of the person to whom the event is due: whom the ego hit first.

        Without a contact it is the first one with whom alone the same motion of the ego would be in
        the event; None if there is nobody like that.
        """
        if measured.record.contact_index is not None:
            return measured.record.contact_index
        walks = measured.trace.walks
        alone = measure([replace(measured.trace, walks=(walk,)) for walk in walks])
        whose = zip(walks, alone, strict=True)
        return next((walk.arrival.index for walk, own in whose if self.event.holds(own)), None)


def _passage(trace: Trace) -> tuple[float | None, float | None]:
    """Time and speed at which the ego's front reached the centre line, interpolated."""
    if not len(trace.x_m) or not trace.x_m[0] < 0.0 <= trace.x_m[-1]:
        return None, None
    times = trace.step_s * np.arange(len(trace.x_m))
    passed_s = float(np.interp(0.0, trace.x_m, times))
    return passed_s, float(np.interp(passed_s, times, trace.speed_mps))


def risk(
    study: Study,
    event: str,
    *,
    arm: Arm,
    target_cv: float,
    engine: EngineName,
    out: Path | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Progress = ignore,
) -> Result:
    """Estimate the probability that an episode ends in an event.

    Args:
        study: a study of one cell.
        event: see ``parse_event``.
        arm: who drives.
        target_cv: target of the standard error divided by the probability.
        engine, workers, executor: as for ``run``.
        out: a new or empty folder; default ``runs/<name>-risk-<next free number>``.
        progress: receives the numbers of finished and planned parts of a round.

    Raises:
        InputError: the scenario, the strategy or the event is refused; nothing has been written.
    """
    if len(study.cells) > 1:
        allowed = f"one cell: one value of {', '.join(sorted(study.varied_keys))}"
        raise InputError(study.name, f"has {len(study.cells)} cells", allowed)
    if not 0 < target_cv <= 1:
        raise InputError(Parameter("target_cv", target_cv), "is not accepted", "above 0, at most 1")
    text, scenario = parse_event(event).text, study.cells[0].scenario
    models = runs.checked_models([scenario], engine)
    chance = [*space_of(scenario, arm).by_chance]
    asked = folders.RiskAsked(event=text, arm=arm.value, target_cv=target_cv, not_sampled=chance)
    manifest = claimed_folder.manifest_of(
        study, models, traces=False, engine=engine, pairs_per_part=0, risk=asked
    )
    path = claimed_folder.claim_folder(out, f"{study.name}-risk")
    with runs.at_work(path, study, workers, executor, MOST_DRAWS) as at_work:
        folders.write_manifest(path, manifest)
        _carried_out(*at_work, progress)
    return read_risk(path)


def resume_risk(
    path: Path,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Progress = ignore,
) -> Result:
    """Continue an interrupted risk; parts that were lost or damaged are made again."""
    _, study = _read(path)
    if not folders.is_finished(path):
        with runs.at_work(path, study, workers, executor, MOST_DRAWS) as at_work:
            _carried_out(*at_work, progress)
    return read_risk(path)


def _carried_out(folder: claimed_folder.RunFolder, executor: Executor, progress: Progress) -> None:
    """Draw the parts that are not done; run events; compute and write the findings."""
    path, (manifest, study) = folder.path, _read(folder.path)
    scenario, asked, known = study.cells[0].scenario, manifest["risk"], manifest["simulated_with"]
    (model,) = runs.checked_models([scenario], manifest["engine"])
    now = claimed_folder.simulated_with(study.driven, [model])
    claimed_folder.refuse_changes(path, known, now)
    arm = Arm(asked["arm"])
    space, event = space_of(scenario, arm), parse_event(asked["event"])
    whole = Task((), model, 0, 0, (arm,), engine=manifest["engine"], code=known["strategies"])

    def draw(proposal: Proposal, round_: int, count: int) -> Units:
        """The units of a round: those of finished parts are read, the others simulated."""
        drawn, tasks, size = dict[int, pa.Table](), list[Task](), part_pairs(count)
        own, cells = _Drawing(space, event, proposal), (Cell(round_, {}, scenario, valid=True),)
        for first in range(0, count, size):
            units = min(size, count - first)
            task = replace(whole, cells=cells, first=first, count=units, own=own)
            try:
                drawn[first] = folders.read_part(path, _TABLE, round_, first, manifest, task.pairs)
            except folders.DamagedPartError:  # or there is none
                tasks.append(task)
        for task, rows in runs.written(tasks, executor, folder, manifest["digest"]):
            drawn[task.first] = rows.tables[round_][_TABLE]
            progress(len(drawn), -(-count // size))
        return Units.of(pa.concat_tables([drawn[first] for first in sorted(drawn)]))

    folder.note("started")
    rng = resampling(manifest["seed"], "risk")
    with threadpool_limits(1, user_api="blas"):  # the last bits depend on the number of threads
        rounds = rounds_of(draw, space, rng, asked["target_cv"], MOST_DRAWS)
    _run_events(path, study, manifest["engine"], rounds[-1], executor)
    folders.write_findings(path, manifest, [CellFindings(0, {}, scenario, risk_findings(rounds))])
    folder.note("finished")


def _read(path: Path) -> tuple[folders.Manifest, Study]:
    manifest = folders.read_manifest(path)
    return manifest, study_from(manifest, str(path / folders.MANIFEST))


def _run_events(
    path: Path, study: Study, engine: EngineName, estimate: Units, executor: Executor
) -> None:
    """Run a systematic sample of the events by their weights; each once."""
    events = path / folders.EVENTS
    if (events / folders.MANIFEST).is_file():
        runs.resume(events, executor=executor)
    elif len(estimate.weights):
        ends = np.cumsum(estimate.weights) / estimate.weights.sum()
        chosen = np.unique(np.searchsorted(ends, (np.arange(_SHOWN) + 0.5) / _SHOWN))
        tree = study.cells[0].scenario.model_dump()
        tree["pedestrians"]["drawn"] = [json.loads(estimate.uniforms[k]) for k in chosen]
        tree["experiment"]["pairs"] = len(chosen)
        scenario = validate(tree, folders.EVENTS)
        cells = (Cell(0, {}, scenario, valid=True),)
        again = Study(f"{study.name}-{folders.EVENTS}", scenario, cells)
        runs.run(again, out=events, engine=engine, executor=executor)


def risk_findings(rounds: Sequence[Units]) -> dict[str, Finding]:
    """The numbers of a risk by key; the estimate is that of the last round alone."""
    estimate = rounds[-1]
    n, value, weighted = estimate.count, estimate.value, estimate.weighted
    summed = ("episodes", "failures", "timed_out_episodes")
    told = {name: Finding(sum(getattr(each, name) for each in rounds)) for name in summed}
    bound, draws, events = risk_draws.bound(rounds)
    total, size = float(value.sum()), effective(value)
    told["probability"] = Finding(None, n=n, events=0)
    told["nominal_high"] = told["all_ways_high"] = Finding(bound, n=draws, events=events)
    if total:
        cv, low, high = risk_draws.interval_of_mean(value, weighted)
        largest = float(value.max()) / total
        tails = special.bdtrc(events - 1, draws, high), special.bdtr(events, draws, low)
        doubts = {
            f"one draw holds {100 * largest:.0f} % of the estimate": largest > _LARGE_SHARE,
            f"the effective sample size is {size:.0f}": size < _SMALL_SAMPLE,
            f"{events:,} of {draws:,} nominal draws are events": min(tails) < _CHECK_TAIL,
        }
        doubt = "; ".join(text for text, holds in doubts.items() if holds and weighted)
        found = Finding(total / n, low, high, n, events=len(estimate.weights))
        told["probability"] = replace(found, reliable=not doubt, reason=doubt or None)
        by_others = 1.0 if bound is None else bound
        told["all_ways_high"] = Finding(min(1.0, high + by_others) if weighted else high)
        told["coefficient_of_variation"] = Finding(cv)
        told["brute_force_episodes"] = Finding(round((n / total - 1) / cv**2) if cv else None)
    if told["failures"].value:
        told["probability_worst"] = Finding(min(1.0, (total + float(estimate.failed.sum())) / n))
    told["effective_sample_size"], told["weighted"] = Finding(size), Finding(n * weighted)
    return {e.key: e.estimate.judged(told.get(e.key, Finding(None))) for e in entries_of("risk")}


def risk_notes(
    found: Findings, asked: folders.RiskAsked, doubt: tuple[str, str] = ("", ""), fit: bool = False
) -> Iterator[Note]:
    """What a reader must know, the worst first.

    Args:
        found: the numbers.
        asked: what the risk is of.
        doubt: that the reference, if it drives, was not validated in such scenes.
        fit: whether people or the driver follow the interaction model.
    """
    p, every = found["probability"], f"{found['episodes'].count:,} episodes"
    failures, late = (found[key].count for key in ("failures", "timed_out_episodes"))
    bounds = (found[key].value for key in ("all_ways_high", "probability_worst"))
    high, worst = (1.0 if bound is None else bound for bound in bounds)  # it says nothing
    cv = found["coefficient_of_variation"].value
    cv, target_cv, chance = np.nan if cv is None else cv, asked["target_cv"], asked["not_sampled"]
    said = (
        ("failures", failures, f"{failures:,} of {every} failed and count as no event.",
         f"If those of the estimate were events, its probability would be {worst:.3g}."),
        ("no_event", p.value is None, "No draw of the estimate ended in the event.",
         f"In {every} no way to it was found, or none that draws could follow. Its probability is "
         f"at most {high:.2g} (95 %)."),
        ("unreliable", p.reliable is False, f"The interval is too narrow: {p.reason}.", ""),
        ("other_ways", found["weighted"].count, "The interval is of the ways to the event that "
         "were found.", f"With all others the probability is at most {high:.2g} (95 %)."),
        ("target_missed", cv > target_cv, "The coefficient of variation is "
         f"{cv:.2g}, above the target of {target_cv:g}.", f"{p.n:,} draws did not suffice."),
        ("timed_out", late, f"{late:,} of {every} timed out and count as no event.", ""),
        ("not_sampled", chance, f"Random, but not sampled: {'; '.join(chance)}.",
         "A way to the event that needs rare values of these is found only by chance."),
        ("not_validated", doubt[0], *doubt),
        ("model_fit", fit, "The error of the model's fit is in no interval, and may be larger.",
         "Compare several models: --set model.path=…."),
    )  # fmt: skip
    for rank, (key, holds, first, more) in enumerate(said):
        if holds:
            yield Note(key, rank, key.replace("_", " "), first, more)


def _found_again(path: Path, manifest: folders.Manifest, study: Study) -> Findings:
    """The numbers of the stored draws, if other code than today's computed the stored numbers."""
    stored = folders.read_findings(path, manifest, study.cells, old=True)
    if stored is None:
        raise folders.unfinished(path)
    rounds, parts = dict[int, list[pa.Table]](), sorted(folders.done_parts(path))
    for (round_, first), (_, end) in zip(parts, [*parts[1:], (0, 0)], strict=True):
        units = range(first, end or first + MOST_DRAWS)  # a round begins with 0
        rows = folders.read_part(path, _TABLE, round_, first, manifest, units)
        rounds.setdefault(round_, []).append(rows)
    drawn = [Units.of(pa.concat_tables(parts)) for parts in rounds.values()]
    if sum(each.episodes for each in drawn) != stored[0]["episodes"].value:
        advice = f"delete {folders.FINDINGS}; `{advised('resume', path)}` draws them again"
        raise InputError(str(path / _TABLE), "parts are missing", advice)
    return risk_findings(drawn)


def read_risk(path: Path) -> Result:
    """What a finished risk says.

    Raises:
        InputError: it is not finished, or its files are damaged.
    """
    manifest, study = _read(path)
    cells = folders.read_findings(path, manifest, study.cells)
    found = _found_again(path, manifest, study) if cells is None else cells[0].findings
    scenario, asked, quoted = study.cells[0].scenario, manifest["risk"], shlex.quote(str(path))
    arm = Arm(asked["arm"])
    driver = scenario.arms.driver(arm)
    doubt = (arm is Arm.HUMAN and not_validated(scenario)) or ("", "")
    fit = scenario.walks_by_model or driver in manifest["know_the_model"]
    numbers = [
        (each.heading, Shown(found[each.key], each.style))
        for each in entries_of("risk")
        if found[each.key].value is not None or each.key == "probability"
    ]
    facts: dict[str, Any] = {"name": study.name, "folder": str(path), "kind": "risk"}
    facts |= {"failed": found["failures"].count, **asked}
    facts |= {key: manifest[key] for key in ("seed", "confidence", "engine")}
    how = "weighted draws" if found["weighted"].count else "draws by brute force"
    episodes = f"{found['episodes'].count:,} episodes with earlier rounds"
    shown = f"Events: harness worst {quoted}/{folders.EVENTS}. Page: harness report {quoted}"
    return Result(
        command="risk",
        title=f"{study.name}: {asked['event']}, {driver}",
        scope=f"{found['probability'].n:,} {how}; {episodes}; seed {manifest['seed']}",
        about=place_in_words([scenario]),
        screen=Table("", (Column("measure", ""), Column("value", "", interval=True)), (*numbers,)),
        full=(),
        notes=(
            *risk_notes(found, asked, doubt, fit),
            *older_code(manifest),
            *retries(folders.tried_again(path)),
        ),
        closing=() if found["probability"].value is None else (shown,),
        facts=facts,
        records=[{"event": asked["event"], "strategy": driver, **found}],
    )
