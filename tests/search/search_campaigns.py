"""Small simulated campaigns: rows by visit and channel, maps with errors, a few candidates."""

from dataclasses import dataclass, replace

import numpy as np

from app.search.candidate import Candidate, Part
from app.search.detectability import Chances, smallest_effects
from app.search.draws import Draws
from app.search.library import read_library
from app.search.problem import make_problem
from app.search.rows import Datum, DeclaredNoise, Nuisance, Rows
from app.search.selection import Selector

REPEATABILITY, SHIFT, TILT, MAP = 1.0, 0.8, 0.4, 0.4
CHANNELS = 2


@dataclass(frozen=True)
class Campaign:
    """Rows with their maps' freedom, and what happened on each of them."""

    rows: Rows
    nuisance: list[Nuisance]
    position: np.ndarray
    direction: np.ndarray
    temperature: np.ndarray
    twin: np.ndarray
    speed: np.ndarray
    time: np.ndarray

    def plus(self, effect):
        return replace(self, rows=replace(self.rows, values=self.rows.values + effect))

    def on(self, channel):
        return self.rows.channel == channel

    def declaring(self, **noise):
        declared = {c: DeclaredNoise(**noise) for c in np.unique(self.rows.channel).tolist()}
        return replace(self, rows=replace(self.rows, noise=declared))


def make_campaign(seed, visits=16, targets=6, datum=Datum.ABSOLUTE, shift=SHIFT):
    """Each visit measures each channel at `targets` random positions in both directions."""
    random = np.random.default_rng(seed)
    each = 2 * targets
    n = visits * CHANNELS * each
    visit = np.repeat(np.arange(visits), CHANNELS * each)
    channel = np.tile(np.repeat(np.arange(CHANNELS), each), visits)
    position = np.repeat(random.uniform(-1, 1, n // 2), 2)
    direction = np.tile([1.0, -1.0], n // 2)
    temperature = np.cumsum(random.normal(0, 1, visits))
    temperature = (temperature - temperature.mean()) / max(temperature.std(), 1e-9)
    twin = 0.95 * temperature + 0.3 * random.normal(0, 1, visits)
    speed = random.uniform(0, 1, visits)
    values = random.normal(0, REPEATABILITY, n)
    values += random.normal(0, shift, (visits, CHANNELS))[visit, channel]
    values += random.normal(0, TILT, (visits, CHANNELS))[visit, channel] * position
    nuisance = []
    for c in range(CHANNELS):
        here = np.flatnonzero(channel == c)
        columns = _table(position, temperature[visit])[here]
        values[here] += columns @ random.normal(0, MAP, columns.shape[1])
        nuisance.append(Nuisance(c, here, MAP * columns))
    rows = Rows(
        values,
        visit,
        channel,
        position[:, None],
        np.full(n, -1),
        minutes=1440.0 * visit,
        noise={c: DeclaredNoise(REPEATABILITY) for c in range(CHANNELS)},
        datum={(v, c): datum for v in range(visits) for c in range(2)},
    )
    return Campaign(
        rows, nuisance, position, direction,
        temperature[visit], twin[visit], speed[visit], visit / visits,
    )  # fmt: skip


def _table(position, temperature):
    """Table entries at five positions, constant and growing with temperature."""
    knots = np.linspace(-1, 1, 5)
    hats = np.clip(1 - np.abs(position[:, None] - knots) / 0.5, 0, None)
    return np.hstack([hats, hats * temperature[:, None]])


def single(campaign, key, family, channel, shape, **how):
    """Make a candidate on one channel from a function of theta."""
    here = np.flatnonzero(campaign.on(channel))

    def columns(theta):
        found = shape(theta)
        return [Part(channel, here, found.reshape(len(found), -1)[here])]

    return Candidate(key, family, columns, **how)


def make_library(campaign, pitches=40):
    """A reversal, a periodic error, speed, a bend, drifts and steps, on each channel."""
    c = campaign
    found = []
    steps = tuple(float(t) for t in np.unique(c.time)[2:-2] - 1e-9)
    for n in range(CHANNELS):
        found += [
            single(c, f"reversal-{n}", "backlash", n, lambda _: c.direction, within_visit=True),
            single(c, f"speed-{n}", "speed", n, lambda _: c.speed),
            single(c, f"speed-squared-{n}", "speed", n, lambda _: c.speed**2),
            single(c, f"bend-{n}", "bend", n, lambda _: c.temperature**2),
            single(c, f"twin-{n}", "sensor", n, lambda _: _with_slope(c, c.twin)),
            single(c, f"drift-{n}", "drift", n, lambda _: c.time, trending=True),
            single(
                c, f"periodic-{n}", "periodic", n, lambda t: waves(c, t),
                grid=tuple(1 / np.linspace(7.0, 1.2, pitches)), bounds=(0.14, 0.85),
                within_visit=True,
            ),
            *(
                single(
                    c, f"smooth-{name}-{n}", "generic", n, lambda _, v=v: smooth(v), generic=True
                )
                for name, v in (("time", c.time), ("speed", c.speed), ("position", c.position))
            ),
        ]  # fmt: skip
        if steps:
            found.append(single(c, f"step-{n}", "step", n, lambda t: (c.time > t) * 1.0,
                                grid=steps, trending=True))  # fmt: skip
    return [*found, fingerprint(c)]


def whole(campaign):
    """The campaign's rows, ready to be searched, in one cell."""
    cells = dict.fromkeys(np.unique(campaign.rows.visit).tolist(), 0)
    everything = np.ones(len(campaign.rows.values), dtype=bool)
    return make_problem(campaign.rows, campaign.nuisance, everything, cells, 1)


def chances_of(campaign, candidates):
    """What it takes to be found, whatever the values are."""
    return Chances.before_measuring(whole(campaign), candidates, Draws(0, 200), 0.01)


def detectable(campaign, candidates):
    """What the rows could show, whatever their values are: the smallest effects."""
    problem = whole(campaign)
    library = read_library(problem, candidates, None)
    states = problem.states(np.ones(1, dtype=bool))
    return smallest_effects(library, states, chances_of(campaign, candidates))


def chosen_in(campaign, candidates=None, seed=0, problem=None):
    """Choose terms as the search does, without anything after it."""
    problem, draws = problem or whole(campaign), Draws(seed, 100)
    library = read_library(problem, candidates or make_library(campaign, pitches=4), draws)
    everything = np.ones(1, dtype=bool)
    return Selector(library, everything, library.testable, 0.01, 1).select(draws).terms


def waves(campaign, pitch):
    angle = 2 * np.pi * campaign.position / pitch
    return np.column_stack([np.sin(angle), np.cos(angle)])


def fingerprint(campaign):
    """One amplitude on both channels, in proportion to different slopes."""
    c = campaign

    def columns(_):
        shapes = (c.position * c.speed, -2.0 * c.position * c.speed)
        return [Part(n, np.flatnonzero(c.on(n)), shapes[n][c.on(n)][:, None]) for n in range(2)]

    return Candidate("fingerprint", "fingerprint", columns)


def smooth(covariate):
    scaled = (covariate - covariate.min()) / (np.ptp(covariate) or 1.0)
    return np.column_stack([np.cos(np.pi * j * scaled) for j in (1, 2, 3)])


def _with_slope(campaign, covariate):
    return np.column_stack([covariate, covariate * campaign.position])
