"""What is believed before any of a machine's own data are seen, each with its reason.

Limits of size and speed, thresholds and tolerances stand where they are used; here stands what
Bayes' rule calls a prior, and the one number that says how much worse harm is than no gain.
Likelihoods are profiled over the grids, or averaged with the weights that are given.
"""

from __future__ import annotations

from typing import Final

import numpy as np

# One observation ---------------------------------------------------------------------------------

DECLARED_WEIGHT: Final = 20.0
"""A declared repeatability counts as much as so many repeated observations."""

ESTIMATED_WEIGHT: Final = 2.0
"""One that was estimated from the same rows only keeps small samples from certainty."""

POOLED_WEIGHT: Final = 10.0
"""One that leans on the replicates of channels that are alike."""

SLIPS: Final = 0.05
"""Share of the rows that may be slips."""

# Set-ups, in variances or standard deviations of one observation ---------------------------------

ASSUMED_SHIFT, ASSUMED_TILT = 0.5, 0.3
"""Where the search for the scatter of set-ups starts, in repeatabilities."""

TIED: Final = (0.0, 0.3, 1.0, 4.0, 16.0, 80.0, 400.0)
"""Multiples of the assumed variances of shift and tilt, tried together."""

APART: Final = ((16.0, 1.0), (200.0, 1.0), (1.0, 16.0), (1.0, 200.0))
"""(shift, tilt), tried apart: a machine may be re-levelled without being turned."""

TIED_OF_RECORDS: Final = (0.0, 1.0, 16.0)
"""Fewer for long set-ups: what moves within them is the wander's."""

WANDERS: Final = (0.05, 0.2, 0.8, 3.0, 12.0, 60.0)
"""Variances of the wander's shift, in those of one observation."""

CORRELATION_TIMES_MIN: Final = (4.0, 12.0, 30.0, 80.0, 200.0)
"""Time constants of the wander. What is slower than the last is called drift, not wander: a
convention, for one channel of one record cannot tell the two apart."""

WIDE: Final = 400.0
"""Variance of the constant of a set-up where too few set-ups tell how they scatter.

It does not grow with anything that is estimated: a wide prior whose determinant depends on a
parameter votes for that parameter.
"""

# What set-ups have in common ---------------------------------------------------------------------

WALK_SIZES: Final = (0.0, *np.geomspace(0.03, 30.0, 13).tolist())
"""Standard deviations of a set-up, and of a step of a walk, in repeatabilities; no walk at all is
as likely as one of any size."""

MEMORIES: Final = (0.0, 2.0, 6.0, 18.0, 54.0)
"""Set-ups after which a share of 1/e of what one had is left in another; 0: each is made anew,
which is as likely as all others together."""

LASTING_SIZES: Final = (0.0, *np.geomspace(0.1, 10.0, 9).tolist())
"""Standard deviations of what a set-up has for itself and of what lasts, in repeatabilities."""

ODD: Final = 0.1
"""Share of the channels whose set-ups are unlike those of the others."""

# Maps and effects --------------------------------------------------------------------------------

UNSTATED_MAP_ERROR: Final = 0.5
"""Standard error where a map states none, in the component's unit."""

OF_MAPS: Final = 0.05
"""Share by which maps that are read at other temperatures may be wrong of what they then say."""

HIDDEN_SIZE: Final = 1.5
"""Standard deviation of what zeros of set-ups hide of an effect, in sizes of what was seen.

A hidden size of zero, known by as much as it is expected to be, is wrong by half of that after
all: so with less than 2 the squares of what is seen lose more than those of what is hidden gain.
"""

TRUST: Final = 0.5
"""Power of a likelihood ratio of two explanations: a model that is a little wrong tells as much
less than it seems to (Miller, Dunson, J. Am. Stat. Assoc. 114 (2019) 1113)."""

HARM: Final = 1.0
"""Harm counts so much beside the squared error: what is lost, counts twice."""

# Responses: medians, and one standard deviation of their logarithms ------------------------------

RESPONSE_OWN: Final = (0.2, 1.0)
RESPONSE_DRIFT: Final = (0.2, 1.0)
"""ρ and ν: repeated warm-ups of one machine differ by a fifth of themselves, or as little as a
tenth, or by half."""

RESPONSE_DRIFT_SPAN: Final = (1.0 / 3.0, 0.7)
"""l as a share of the time from the first set-up to the last: what changes far quicker is a
set-up's alone, what changes far slower is common."""

RESPONSE_NOISE: Final = ((0.04, 1.0), (0.2, 1.0), (300.0, 0.7), (0.15, 1.0), (100.0, 0.7))
"""White noise, rough wander, its time constant [min], smooth wander, its time constant, sizes as
shares of all values: an instrument resolves some percent of what is to be corrected, and air and
foundation move within hours."""

START_SHARE: Final = 0.3
"""s_g begins at this share of what would explain everything alone. Its prior is exponential with
that unit as its mean."""

FREEDOM: Final = 4.0
"""Degrees of freedom of Student's t: a set-up that is off by five standard deviations counts a
sixth."""

MAPS_SHARE: Final = 0.5
"""Prior mean of the maps' coefficient, and the size of its scale: between useless and right."""

SWING: Final = 0.5
"""Power of a sensor's swing by which its coefficients are expected smaller: halfway between alike
per kelvin, as bodies expand, and alike by the whole swing, as a nozzle at 200 °C moves no more than
its frame."""

# The watch ---------------------------------------------------------------------------------------

WATCH_SETUPS: Final = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Scatters of set-ups that are possible, in repeatabilities."""

WATCH_SETUP_WEIGHTS: Final = (0.004, 0.01, 0.03, 0.1, 0.25, 0.606)
"""How much each is believed at first: rather too much scatter than a false alarm."""

WATCH_CORRELATIONS: Final = (0.0, 0.5, 0.85)
"""Correlations with the visit before that are possible."""

WATCH_CORRELATION_WEIGHTS: Final = (0.6, 0.2, 0.2)
"""How much each is believed at first."""

CHANGED_BETWEEN: Final = 0.02
"""Share of the steps from visit to visit at which the constant may have changed, and then by how
much: else one step would for long be taken for a wide scatter of set-ups."""

CHANGED_BY: Final = 30.0
"""[repeatabilities]"""
