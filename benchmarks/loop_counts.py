"""How often the loop is right, over HTTP, with default adoption: campaigns of known truth, counted.

Each campaign goes the way that a shop's does: the machine, its maps, readings and verifications
are sent, an analysis is asked for, what helps is adopted unasked, and the model before and after
is held against later places whose true errors, free of measurement, are sent at the end. What
came of each is appended to a file as it comes, so that a count that is broken off can be
continued; the tables are made of the file alone.

    python -m benchmarks.loop_counts counts.jsonl [--sections visits record …] [--campaigns 1]
        [--first-seed 1] [--processes 2] [--minutes 60]
    python -m benchmarks.loop_counts counts.jsonl --table
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final

import httpx
import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import beta

from app.arrays import FloatArray
from app.main import create_app
from app.settings import Settings
from app.simulation.undeclared import UNKNOWN, make_campaign, make_record
from app.simulation.undeclared.campaign import Campaign
from app.simulation.undeclared.components import COMPONENTS
from benchmarks.closing_the_loop_judge import judge
from benchmarks.outside_machine import CAUSES, make_outside
from thermap import AsyncThermapClient, ThermapClientError
from thermap.answers import AnalysisResult

HARM: Final = 1.1
"""An adoption does harm that makes later truth worse by more than a tenth."""

NEAR: Final = 1.1
"""Later truth is near to a perfect correction's within so many times it."""

WITHIN: Final = 1.96
STEMS: Final = ("slope", "reversal", "drift", "step", "curvature", "angle")
"""What answers call amplitudes that the simulator states in mid-travel and from there on."""

OCTAVE: Final = 0.71
"""A found pitch below so much of a planted one is its second harmonic's, which is half of it."""

AT_ONCE: Final = 10_000
LOOK_EVERY_S: Final = 1.5

PLANTED: Final = (
    *("thermal-lag:component", "thermal-lag:sensor", "other-sensor", "additional-sensor"),
    *("sensor-gradient", "temperature-curvature", "state-variable:speed"),
    *("state-variable:speed-lagged", "backlash:constant", "backlash:along-axis"),
    *("periodic:single", "periodic:harmonic", "angular:roll", "angular:yaw"),
    *("nonrigid-slope:linear", "sensor-fault:bias"),
)
"""Effects that show in visits and in one set-up of hours alike."""
IN_VISITS: Final = (
    *("state-variable:payload", "drift:component", "step:component"),
    *("outdated-map:slope", "outdated-map:profile"),
)
IN_RECORD: Final = (
    *("state-variable:speed-squared", "state-variable:feed", "state-variable:feed-lagged"),
    *("nonrigid-slope:angular", "angular:pitch"),
)
MISTAKES: Final = (
    *("exchanged-sensors", "map-factor", "map-temperature", "clock-offset", "mirrored-axis"),
    *("late-sensor", "ageing-sensor", "detached-sensor", "tool-length", "wrong-map"),
)

NOISE: Final[Mapping[str, Mapping[str, Any]]] = {
    "white": {},
    "wander 8 min": {"wander_um": 1.0, "wander_tilt_um": 0.5, "wander_min": 8.0},
    "wander 30 min": {"wander_um": 1.0, "wander_tilt_um": 0.5, "wander_min": 30.0},
    "heavy tails": {"heavy_tails": True},
    "quantised": {"measured_quantum_um": 1.0},
    "instrument drifts": {"instrument_drift_um_per_h": 1.0},
    "set-ups of 0.6, squareness": {
        "setup_shift_um": 0.6,
        "observations_per_visit": 24,
        "visits": 20,
    },
}
UNKIND: Final[Mapping[str, Mapping[str, Any]]] = {
    **NOISE,
    "set-ups correlated": {"setup_shift_um": 1.0, "setup_tilt_um": 0.5, "setup_correlation": 0.85},
    "laser warms up": {"warm_up_um": 2.0, "warm_up_min": 5.0},
    "no air compensation": {"length_um_per_m_per_k": -0.93},
    "no material temperature": {"length_um_per_m_per_k": 11.7, "length_sensor": "bed"},
    "outliers": {"outliers": 0.02, "state_repeatability": False},
    "zeroed at the first": {"datum": "first"},
    "each visit its own zero": {"datum": "free"},
}
OF_RECORDS: Final[Mapping[str, Mapping[str, Any]]] = {"new places": {"new_places": True}}
"""Each block at places of its own, as visits are."""

BY_INSTRUMENT: Final = {
    "laser warms up": frozenset({"instrument-warm-up"}),
    "instrument drifts": frozenset({"instrument-warm-up", "drift"}),
    "no air compensation": frozenset({"instrument-compensation"}),
    "no material temperature": frozenset({"instrument-compensation"}),
}
"""What is rightly named where the instrument does it, though nothing is planted."""

OF_VISITS: Final = ("visits", "observations_per_visit")


@dataclass(frozen=True)
class Task:
    """One campaign: which section counts it, what is planted, how it is measured."""

    section: str
    seed: int
    condition: str
    planted: str
    visits: int = 60
    hours: float | None = None
    amplitude: float = 2.0

    @property
    def key(self) -> str:
        """Tell it from all others."""
        return json.dumps(asdict(self), sort_keys=True)

    def made(self) -> Campaign:
        """Simulate it, of the project's own simulator."""
        planted = [self.planted] if self.planted else []
        stated = {"later_visits": 20, **{**UNKIND, **OF_RECORDS}[self.condition]}
        if self.hours is not None:
            stated = {k: v for k, v in stated.items() if k not in OF_VISITS}
            return make_record(self.seed, planted, self.amplitude, hours=self.hours, **stated)
        stated = {"visits": self.visits, **stated}
        return make_campaign(self.seed, planted, self.amplitude, **stated)


@dataclass(frozen=True)
class Sent:
    """What a task sends, and what is true.

    `perfect_left` is what a perfect correction leaves of each later value; None: not known.
    """

    machine: dict[str, Any]
    error_maps: list[dict[str, Any]]
    assignment: dict[str, str]
    readings: list[dict[str, Any]]
    verifications: list[dict[str, Any]]
    later: dict[str, Any]
    perfect_left: FloatArray | None = None


def tasks_of(asked: argparse.Namespace) -> Iterator[Task]:
    """List the campaigns of each section in turn, so that a count broken off has some of each."""
    listed = {name: list(SECTIONS[name](asked)) for name in asked.sections}
    for row in itertools.zip_longest(*listed.values()):
        yield from (task for task in row if task is not None)


def _seeds(asked: argparse.Namespace) -> range:
    return range(asked.first_seed, asked.first_seed + asked.campaigns)


def _visits(asked: argparse.Namespace) -> Iterator[Task]:
    for seed in _seeds(asked):
        for n, name in enumerate((*PLANTED, *IN_VISITS)):
            yield Task("visits", 100 * seed + n, "white", name, 40)


def _record(asked: argparse.Namespace) -> Iterator[Task]:
    for seed in _seeds(asked):
        for n, name in enumerate((*PLANTED, *IN_RECORD)):
            for condition in ("white", *OF_RECORDS):
                yield Task("record", 100 * seed + 50 + n, condition, name, hours=asked.hours)


def _nothing(asked: argparse.Namespace) -> Iterator[Task]:
    for seed in _seeds(asked):
        for number in range(15):
            for n, condition in enumerate(NOISE):
                yield Task("nothing", 1000 * seed + 10 * number + n, condition, "", 20)
                if number % 3 == 2 and n < 6:
                    one = 1000 * seed + 500 + 10 * number + n
                    yield Task("nothing", one, condition, "", hours=8.0)


def _harm(asked: argparse.Namespace) -> Iterator[Task]:
    causes = (*UNKNOWN, *MISTAKES, *PLANTED, *IN_VISITS)
    conditions = list(UNKIND)
    for seed in _seeds(asked):
        for n, cause in enumerate(causes):
            # With each seed the next one, so that every cause comes to be measured in every way.
            condition = conditions[(n + seed - 1) % len(conditions)]
            yield Task("harm", 10_000 * seed + n, condition, cause, 30)
        for n, cause in enumerate(UNKNOWN):
            one = 10_000 * seed + 500 + n
            yield Task("harm", one, "wander 30 min", cause, hours=8.0)


def _outside(asked: argparse.Namespace) -> Iterator[Task]:
    for seed in _seeds(asked):
        for number in range(3):
            for cause in CAUSES:
                yield Task("outside", 100 * seed + number, "white", cause, 24)


def _few(asked: argparse.Namespace) -> Iterator[Task]:
    causes = ("", "thermal-lag:component", "hysteresis", "state-variable:speed", "outdated-map")
    for seed in _seeds(asked):
        for number in range(4):
            for n, cause in enumerate(causes):
                for visits in (8, 15):
                    one = 3000 * seed + 10 * number + n
                    condition = "set-ups correlated" if number % 2 else "white"
                    yield Task("few", one, condition, cause, visits)


def _watch(asked: argparse.Namespace) -> Iterator[Task]:
    for seed in _seeds(asked):
        for number in range(20):
            for condition in ("white", "set-ups correlated"):
                one = 5000 * seed + number
                yield Task("watch", one, condition, "", 25)
                if number % 2:
                    yield Task("watch", one, condition, "step:component", 25, amplitude=6.0)


SECTIONS: Final = {
    "visits": _visits,
    "record": _record,
    "nothing": _nothing,
    "harm": _harm,
    "outside": _outside,
    "few": _few,
    "watch": _watch,
}


def run(task: Task) -> dict[str, Any]:
    """Send one campaign to a service of its own, and say what came of it."""
    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(_run(task, Path(folder)))


async def _run(task: Task, folder: Path) -> dict[str, Any]:
    sent, truth, oracle_um = _sent(task)
    service = create_app(Settings(database_url=f"sqlite:///{folder / 'counts.db'}"))
    transport = httpx.ASGITransport(app=service)
    machine = sent.machine["id"]
    try:
        async with AsyncThermapClient("http://localhost", transport=transport) as thermap:
            await _furnish(thermap, sent)
            numbers = [
                (await thermap.store_verification(machine, body)).id for body in sent.verifications
            ]
            watch = await thermap.watch(machine)
            beyond = [one.status == "beyond" for one in watch.verifications]
            outcome = {
                "key": task.key,
                "task": asdict(task),
                "truth": truth,
                "alarm_visit": beyond.index(True) if True in beyond else None,
                "changed_visit": _changed_visit(sent, truth),
            }
            if task.section == "watch":
                return outcome
            first = (await thermap.machine(machine)).active_model
            job = await thermap.analyse(machine, {"verifications": numbers})
            result, seconds = await _finished(thermap, machine, job.id)
            last, refused = first, ""
            if any(effect.helps for effect in result.effects):
                try:
                    last = (await thermap.adopt_analysis(machine, job.id)).version
                except ThermapClientError as error:
                    refused = str(error)
            later = (await thermap.store_verification(machine, sent.later)).id
            before, after = [
                await _left_um(thermap, machine, later, version) for version in (first, last)
            ]
            learnt = await _left_where_learnt(thermap, sent, last)
    finally:
        service.state.runner.stop()
        service.state.context.database.close()
    return outcome | {
        "verdict": result.verdict,
        "effects": [_told(effect) for effect in result.effects],
        "adopted": sum(effect.helps for effect in result.effects) if last != first else 0,
        "refused": refused,
        "before_um": before,
        "after_um": after,
        "floor_um": None if sent.perfect_left is None else _rms(sent.perfect_left),
        "oracle_um": oracle_um,
        "where_learnt": learnt,
        "seconds": seconds,
    }


def _changed_visit(sent: Sent, truth: Sequence[Mapping[str, Any]]) -> int | None:
    """Find the first visit after a step; None where none is planted."""
    at_min = [t["parameters"]["at_min"] for t in truth if t.get("kind") == "step"]
    if not at_min:
        return None
    changed = _time(sent.readings[0]["time"]) + timedelta(minutes=at_min[0])
    begins = [_time(body["observations"][0]["time"]) for body in sent.verifications]
    return sum(begin < changed for begin in begins)


def _time(stated: str | datetime) -> datetime:
    return stated if isinstance(stated, datetime) else datetime.fromisoformat(stated)


def _sent(task: Task) -> tuple[Sent, list[dict[str, Any]], float | None]:
    """Make what is sent, the truth, and the later error of an oracle."""
    if task.section == "outside":
        outside = make_outside(task.seed, task.planted, task.visits)
        sent = Sent(
            outside.machine,
            outside.error_maps,
            outside.assignment,
            outside.readings,
            outside.verifications,
            outside.later,
        )
        right = {
            "kinds": sorted(outside.right),
            "components": sorted(outside.components),
            "form": outside.form,
        }
        return sent, [right], None
    made = task.made()
    effects = [dict(effect) for effect in made.truth.effects]
    asked, at = [], 0
    for place in made.later.asked:
        size = 1 if "component" in place else 3
        values = made.later.true_um[at : at + size].round(4).tolist()
        asked.append(place | {"measured_um": values[0] if size == 1 else values})
        at += size
    known = set(made.maps.codes) if hasattr(made.maps, "codes") else set(COMPONENTS)
    assignment = {code: COMPONENTS[code].sensor for code in COMPONENTS if code in known}
    oracle = None
    if len(effects) == 1:
        share = float(made.oracle([]).amplitudes[0])
        oracle = made.later.error_um(share * made.later.contribution_um)
    later = {"label": "later", "datum": "absolute", "observations": asked}
    sent = Sent(
        made.machine,
        made.error_maps,
        assignment,
        made.readings,
        made.verifications,
        later,
        made.later.true_um - made.later.predicted_um - made.later.contribution_um,
    )
    return sent, effects, oracle


async def _furnish(thermap: AsyncThermapClient, sent: Sent) -> None:
    machine = sent.machine["id"]
    await thermap.create_machine(sent.machine)
    for body in sent.error_maps:
        await thermap.store_error_map(machine, body)
    mapped = {table["component"] for table in sent.error_maps[0]["components"]}
    await thermap.assign_sensors(
        machine, {code: s for code, s in sent.assignment.items() if code in mapped}
    )
    for begin in range(0, len(sent.readings), AT_ONCE):
        await thermap.store_readings(machine, sent.readings[begin : begin + AT_ONCE])


async def _finished(
    thermap: AsyncThermapClient, machine: str, number: int
) -> tuple[AnalysisResult, float]:
    begun = time.perf_counter()
    while True:
        analysis = await thermap.analysis(machine, number)
        if analysis.status not in ("queued", "running"):
            if analysis.result is None:
                raise RuntimeError(f"analysis came to no answer: {analysis.message}")
            return analysis.result, time.perf_counter() - begun
        await asyncio.sleep(LOOK_EVERY_S)


async def _left_um(
    thermap: AsyncThermapClient, machine: str, later: int, version: int | None
) -> float:
    """Root mean square of truth minus prediction over all later values."""
    answer = await thermap.verification_residuals(
        machine, later, model_version=version, rows=AT_ONCE
    )
    return _rms([row.measured - row.predicted for row in answer.rows])


async def _left_where_learnt(
    thermap: AsyncThermapClient, sent: Sent, version: int | None
) -> dict[str, float] | None:
    """Say the same of those later values alone at which no effect is held.

    Elsewhere the service itself says that the effect stays what it was at the edge of what it was
    learnt in. `share` is how many of all values they are, `floor_um` what a perfect correction
    leaves of them.
    """
    if sent.perfect_left is None:
        return None
    asked = [{k: v for k, v in o.items() if k != "measured_um"} for o in sent.later["observations"]]
    answer = await thermap.predict(sent.machine["id"], asked, version, "zero")
    true = [np.atleast_1d(one["measured_um"]) for one in sent.later["observations"]]
    is_learnt = np.repeat([said != "held" for said in answer.status], [one.size for one in true])
    said = [
        np.full(one.size, np.nan) if values is None else np.atleast_1d(values)
        for one, values in zip(true, answer.predicted_um, strict=True)
    ]
    left = np.concatenate(true) - np.concatenate(said)
    is_learnt &= np.isfinite(left)
    return {
        "share": float(is_learnt.mean()),
        "after_um": _rms(left[is_learnt]),
        "floor_um": _rms(sent.perfect_left[is_learnt]),
    }


def _rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _told(effect: Any) -> dict[str, Any]:
    tied = [
        {
            "kind": other.kind,
            "variant": other.variant,
            "components": other.components,
            "sensors": other.sensors,
            "states": other.states,
            "tied": True,
        }
        for other in effect.alternatives
        if other.tied
    ]
    return {
        "kind": effect.kind,
        "variant": effect.variant,
        "components": effect.components,
        "sensors": effect.sensors,
        "states": effect.states,
        "status": effect.status,
        "helps": effect.helps,
        "why_not": effect.why_not,
        "parameters": effect.parameters,
        "standard_errors": effect.standard_errors,
        "explanation": effect.explanation,
        "doubts": effect.doubts,
        "alternatives": tied,
    }


def main() -> None:
    """Count what was asked for, and print the tables of all that the file has."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("file", type=Path, help="where outcomes are appended, a line each")
    parser.add_argument("--sections", nargs="*", default=list(SECTIONS), choices=list(SECTIONS))
    parser.add_argument("--campaigns", type=int, default=1, help="rounds of each section")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--hours", type=float, default=30.0, help="of records with an effect")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=1e6, help="begin none after so long")
    parser.add_argument("--table", action="store_true", help="count nothing, print the tables")
    asked = parser.parse_args()
    if not asked.table:
        count(asked)
    show([json.loads(line) for line in asked.file.read_text().splitlines()])


def count(asked: argparse.Namespace) -> None:
    """Run all campaigns that the file does not have, and append what came of each."""
    lines = asked.file.read_text().splitlines() if asked.file.exists() else []
    done = {json.loads(line)["key"] for line in lines}
    until = time.monotonic() + 60.0 * asked.minutes
    waiting = (task for task in tasks_of(asked) if task.key not in done)
    with ProcessPoolExecutor(asked.processes) as pool, asked.file.open("a") as out:
        running = {pool.submit(run, t): t for t in itertools.islice(waiting, asked.processes)}
        while running:
            future = next(as_completed(running))
            task = running.pop(future)
            try:
                outcome = future.result()
            except Exception as error:  # one campaign's failure must not end the count
                outcome = {"key": task.key, "task": asdict(task), "failed": repr(error)}
            out.write(json.dumps(outcome) + "\n")
            out.flush()
            if time.monotonic() < until:
                running |= {pool.submit(run, t): t for t in itertools.islice(waiting, 1)}


def show(outcomes: Sequence[Mapping[str, Any]]) -> None:
    """Print what was counted: by section, wrong answers one by one, and intervals."""
    counted = [judged(one) for one in outcomes if "verdict" in one]
    for failed in (one for one in outcomes if "failed" in one):
        print(f"failed: {failed['key']}: {failed['failed']}")
    for one in counted:
        if one.harms or one.wrong or one.is_false or one.is_missed:
            _tell(one)
    groups: dict[str, list[Judged]] = defaultdict(list)
    for one in counted:
        groups[one.section].append(one)
        groups["all"].append(one)
        if not one.task["planted"] or one.task["planted"] == "nothing":
            groups["nothing in them, all sections"].append(one)
            groups[f"nothing, {one.task['condition']}"].append(one)
    print(f"\n{'counted':34}    n  harm  confirmed, wrong of  false  unexplained  alarms  s")
    for name, group in groups.items():
        is_nothing = [o for o in group if o.task["planted"] in ("", "nothing")]
        unexplained = sum(o.judgement == "unexplained" for o in is_nothing)
        confirmed = sum(o.confirmed for o in group)
        print(
            f"{name:34} {len(group):4} {sum(o.harms for o in group):5} "
            f"{sum(len(o.wrong) for o in group):10} of {confirmed:4} "
            f"{sum(o.is_false for o in group):4} of {len(is_nothing)} {unexplained:6}"
            f"{sum(o.alarm is not None for o in is_nothing):10} "
            f"{np.median([o.seconds for o in group]):8.0f}"
        )
    for section, group in groups.items():
        words = Counter(o.judgement for o in group)
        print(f"{section}: " + ", ".join(f"{word} {n}" for word, n in words.most_common()))
    over = [o.ratio for o in counted if o.ratio is not None]
    if over:
        print(f"\nerror after adoption / oracle's: median {np.median(over):.2f} of {len(over)}")
    _show_later_truth([one for one in counted if one.outcome["floor_um"] and one.outcome["truth"]])
    _show_intervals(counted)
    _show_watch([one for one in outcomes if one["task"]["section"] == "watch"])
    harmed, tried = sum(o.harms for o in counted), len(counted)
    print(f"harm: {harmed} of {tried}, at most {_upper(harmed, tried):.1%} (95 %, one-sided)")


@dataclass(frozen=True)
class Judged:
    """An outcome and what it is worth."""

    section: str
    task: Mapping[str, Any]
    judgement: str
    confirmed: int
    wrong: list[Mapping[str, Any]]
    is_false: bool
    harms: bool
    alarm: int | None
    ratio: float | None
    inside: list[tuple[str, bool, float]]
    seconds: float
    outcome: Mapping[str, Any]

    @property
    def is_missed(self) -> bool:
        """Whether a planted effect of the library is not among what was named."""
        missed = ("missed", "wrong", "extra", "part", "wrong name")
        return self.section in ("visits", "record") and self.judgement.startswith(missed)


def judged(outcome: Mapping[str, Any]) -> Judged:
    """Judge one campaign."""
    task, truth, effects = outcome["task"], outcome["truth"], outcome["effects"]
    lies = BY_INSTRUMENT.get(task["condition"], frozenset()) - {e.get("kind") for e in truth}
    own = [e for e in effects if e["kind"] not in lies]
    confirmed = [e for e in own if e["status"] == "confirmed"]
    if task["section"] == "outside":
        word, wrong = _judge_outside(outcome, own, confirmed)
        is_nothing = task["planted"] == "nothing"
    else:
        word = judge({**outcome, "effects": own}, truth)
        wrong = [
            e
            for e in confirmed
            if judge({"effects": [e], "verdict": "effects-found"}, truth)
            in ("wrong", "false", "wrong name", "missed")
        ]
        is_nothing = not truth
    ratio = None
    if outcome["oracle_um"] and outcome["adopted"]:
        ratio = outcome["after_um"] / outcome["oracle_um"]
    inside = [] if task["section"] == "outside" else list(_intervals(own, truth))
    return Judged(
        task["section"],
        task,
        word,
        len(confirmed),
        wrong,
        is_nothing and bool(own),
        outcome["after_um"] > HARM * outcome["before_um"],
        outcome["alarm_visit"],
        ratio,
        inside,
        outcome["seconds"],
        outcome,
    )


def _judge_outside(
    outcome: Mapping[str, Any],
    own: Sequence[Mapping[str, Any]],
    confirmed: Sequence[Mapping[str, Any]],
) -> tuple[str, list[Mapping[str, Any]]]:
    """Judge by the kinds that name the cause rightly, and in its form, on what it acts on."""
    (truth,) = outcome["truth"]
    kinds, struck = set(truth["kinds"]), set(truth["components"])
    form = truth.get("form")  # files that were begun before it was told have none

    def is_right(effect: Mapping[str, Any]) -> bool:
        named = {effect["kind"], *(other["kind"] for other in effect["alternatives"])}
        where = {code.lower() for code in effect["components"]}
        said = [*effect.get("doubts", ()), *(one["variant"] for one in effect["alternatives"])]
        is_formed = form is None or any(form in words for words in said)
        return bool(named & kinds) and is_formed and (not struck or bool(where & struck))

    is_open = outcome["verdict"] in ("unexplained", "not-judged")
    wrong = [e for e in confirmed if not is_right(e)]
    if outcome["task"]["planted"] == "nothing":
        return "false" if own else "unexplained" if is_open else "nothing", wrong
    if not own:
        return "unexplained" if is_open else "missed", wrong
    if all(is_right(e) for e in own):
        return "named", wrong
    if any(is_right(e) for e in own):
        return "named, and more", wrong
    return "proxy" if is_open else "wrong name", wrong


def _intervals(
    effects: Sequence[Mapping[str, Any]], truth: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[str, bool, float]]:
    """Give parameter, whether its 95 % interval holds the truth, and its error in standard ones."""
    for true in truth:
        for effect in effects:
            alone = judge({"effects": [effect], "verdict": "effects-found"}, [true])
            if not true["in_library"] or alone != "alone" or not _is_of_form(effect, true):
                continue
            for name, value in _truths(true, effect).items():
                found = {k: v for k, v in effect["parameters"].items() if _is_named(k, name)}
                # A shape without a slope along the axis says nothing of mid-travel alone.
                for key, estimate in found.items():
                    error = effect["standard_errors"].get(key)
                    if error:
                        signed = value
                        if true["kind"] == "sensor-gradient" and (
                            effect["sensors"] != true["sensors"]
                        ):
                            signed = -value
                        z = (estimate - signed) / error
                        yield f"{true['kind']} {name}", abs(z) <= WITHIN, z


def _is_of_form(effect: Mapping[str, Any], true: Mapping[str, Any]) -> bool:
    """Whether sizes can be compared: that of a state's square is in another unit."""
    is_square = true["parameters"].get("power") == 2
    return true["kind"] != "state-variable" or is_square == ("squared" in effect["variant"])


def _is_named(key: str, name: str) -> bool:
    stem, _, rest = key.partition("_")
    if name == "level":
        return stem in STEMS and not rest.startswith("rise_")
    if name == "rise":
        return stem in STEMS and rest.startswith("rise_")
    return key == name


def _truths(true: Mapping[str, Any], effect: Mapping[str, Any]) -> dict[str, float]:
    """Translate the simulator's parameters into what an answer calls them."""
    own = true["parameters"]
    found: dict[str, float] = {}
    for name in ("time_constant_min", "pitch_mm", "late_min"):
        if name in own:
            found[name] = own[name]
    if "bias_c" in own:
        found["bias_k"] = own["bias_c"]
    if "first_um" in own:
        found["amplitude_um"] = own["first_um"]
        if "second_um" in own and effect["parameters"]["pitch_mm"] < OCTAVE * own["pitch_mm"]:
            found |= {"amplitude_um": own["second_um"], "pitch_mm": 0.5 * own["pitch_mm"]}
    if true["kind"] == "backlash":
        found |= {"level": 2.0 * own["half_level_um"], "rise": 2.0 * own["half_slope_um"]}
        return found
    per = own["full_scale"] ** own["power"] if "full_scale" in own else 1.0
    for key, value in own.items():
        if key.startswith("level_"):
            found["level"] = value / per
        if key.startswith("slope_"):
            found["rise"] = value / per
    return found


def _show_later_truth(planted: Sequence[Judged]) -> None:
    """Say how near later truth comes to a perfect correction's, and where that was to be had.

    Outside where an effect was learnt it is held, and nobody claims that it is right there: those
    values are counted apart. An oracle knows the effect, and fits its size to the same rows.
    """
    groups: dict[tuple[str, str], list[Judged]] = defaultdict(list)
    for one in planted:
        groups[one.section, one.task["condition"]].append(one)
    for (section, condition), group in groups.items():
        ratios = [_of_floor(one.outcome) for one in group]
        near = [
            sum(ratio is not None and ratio <= NEAR for ratio in own)
            for own in zip(*ratios, strict=True)
        ]
        print(
            f"\n{section}, {condition}: later truth within {NEAR} of the floor in {near[0]} of "
            f"{len(group)}, where all was learnt in {near[1]}; an oracle's in {near[2]}"
        )
        for one, (whole, learnt, oracle) in zip(group, ratios, strict=True):
            told = ", ".join(
                f"{name} {ratio:.2f}"
                for name, ratio in (("", whole), ("where learnt", learnt), ("oracle", oracle))
                if ratio is not None
            )
            print(f"    {one.task['planted']:30} {one.judgement}:{told}")


def _of_floor(outcome: Mapping[str, Any]) -> tuple[float, float | None, float | None]:
    """Divide by the floor: later truth, that where effects were learnt, and an oracle's."""
    learnt, oracle = outcome.get("where_learnt"), outcome["oracle_um"]
    return (
        outcome["after_um"] / outcome["floor_um"],
        learnt["after_um"] / learnt["floor_um"] if learnt else None,
        oracle / outcome["floor_um"] if oracle else None,
    )


def _show_intervals(counted: Sequence[Judged]) -> None:
    by_name: dict[str, list[tuple[bool, float]]] = defaultdict(list)
    for one in counted:
        for name, is_inside, z in one.inside:
            by_name[name].append((is_inside, z))
            by_name["all"].append((is_inside, z))
    print("\n95 % intervals that hold the truth; largest error in standard ones")
    for name, group in sorted(by_name.items()):
        held = sum(is_inside for is_inside, _ in group)
        print(f"{name:40} {held:3} of {len(group):3}   {max(abs(z) for _, z in group):.1f}")


def _show_watch(outcomes: Sequence[Mapping[str, Any]]) -> None:
    groups: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for one in outcomes:
        if "failed" not in one:
            groups[one["task"]["condition"]].append(one)
    for condition, group in groups.items():
        same = [o["alarm_visit"] is not None for o in group if not o["truth"]]
        print(f"watch, {condition}: alarms on {sum(same)} of {len(same)} unchanged machines;")
        delays = [
            None if o["alarm_visit"] is None else o["alarm_visit"] - o["changed_visit"] + 1
            for o in group
            if o["truth"]
        ]
        print(f"    changed ones seen in the visit after the change (0 or less: before): {delays}")


def _tell(one: Judged) -> None:
    flags = " HARM" * one.harms + " WRONG" * bool(one.wrong) + " FALSE" * one.is_false
    o = one.outcome
    floor = "" if o["floor_um"] is None else f", floor {o['floor_um']:.2f}"
    print(
        f"{one.section} seed {one.task['seed']} {one.task['condition']} "
        f"hours {one.task['hours']} visits {one.task['visits']}: "
        f"{one.task['planted'] or 'nothing'} -> {one.judgement} ({o['verdict']}) "
        f"{o['before_um']:.2f} -> {o['after_um']:.2f}{floor}{flags}\n    truth "
        + "; ".join(str({k: v for k, v in t.items() if k != "amplitude_is"}) for t in o["truth"])
    )
    for e in o["effects"]:
        tied = [f"{a['kind']} {a['components']} {a['sensors']}" for a in e["alternatives"]]
        print(
            f"    {e['status']}{', helps' * e['helps']}: {e['explanation']}"
            + f" ~ {tied}" * bool(tied)
        )


def _upper(hits: int, tried: int) -> float:
    """Upper end of the one-sided 95 % interval of a share (Clopper, Pearson)."""
    return float(beta.ppf(0.95, hits + 1, tried - hits)) if hits < tried else 1.0


if __name__ == "__main__":
    main()
