"""What follows a temperature with play, by hand, and at the times that are asked for."""

import numpy as np

from app.effects.conditions import Lags, RecordedLags, Recording, Signal
from app.effects.play import play, play_at

BED = Signal("temperature", "bed")


def followed(inputs, half_width=1.0, times_s=None, **how):
    times_s = 60.0 * np.arange(len(inputs)) if times_s is None else np.array(times_s)
    return play(times_s, np.array(inputs), half_width, **how).tolist()


def test_it_follows_at_half_the_band_and_stays_while_the_input_goes_back_within_it():
    rises = [0.0, 1.0, 2.0, 3.0]
    goes_back = [2.5, 1.0, 2.0]
    falls = [0.5, -1.0]
    found = followed([*rises, *goes_back, *falls, 0.0, 1.0, 1.5])
    assert found[2:] == [1.0, 2.0, 2.0, 2.0, 2.0, 1.5, 0.0, 0.0, 0.0, 0.5]


def test_it_is_not_known_until_the_input_has_crossed_the_whole_band():
    """From wherever in the band it began, it is at the same place from then on."""
    found = np.array(followed([0.0, 0.9, -0.9, 0.5, 1.1, 0.0]))
    assert np.isnan(found[:4]).all()
    assert found[4:].round(12).tolist() == [0.1, 0.1]


def test_how_fast_the_input_moved_does_not_matter():
    slowly = followed(np.concatenate([np.linspace(0, 5, 51), np.linspace(5, 1, 41)]))
    at_once = followed([0.0, 5.0, 1.0])
    assert slowly[-1] == at_once[-1] == 2.0


def test_after_a_gap_nothing_is_known_of_the_past():
    times_s = [0.0, 60.0, 7200.0, 7260.0, 7320.0]
    found = followed([0.0, 3.0, 3.0, 4.0, 6.0], times_s=times_s, max_gap_s=600.0)
    assert np.isnan(found).tolist() == [True, False, True, True, False]
    assert found[4] == 5.0


def test_between_readings_the_input_goes_straight():
    times_s, read = np.array([0.0, 60.0, 120.0]), np.array([0.0, 4.0, 0.0])
    played = play(times_s, read, 1.0)
    asked_s = np.array([-1.0, 75.0, 90.0, 105.0, 110.0])
    then = np.array([0.0, 3.0, 2.0, 1.0, np.nan])
    found = play_at(times_s, played, 1.0, asked_s, then)
    np.testing.assert_array_equal(found, [np.nan, 3.0, 3.0, 2.0, np.nan])


def test_a_record_says_what_follows_a_sensor_with_play():
    times_s = 60.0 * np.arange(5)
    read = Recording(times_s, np.array([20.0, 24.0, 22.0, 21.0, 25.0]), 600.0, times_s[:1])
    lags = RecordedLags({("temperature", "bed"): read})
    asked_s = np.array([30.0, 60.0, 150.0, 240.0])
    np.testing.assert_allclose(lags.played(BED, 1.0, asked_s), [np.nan, 23.0, 22.5, 24.0])
    assert np.isnan(lags.played(Signal("temperature", "room"), 1.0, asked_s)).all()
    assert np.isnan(Lags().played(BED, 1.0, asked_s)).all()
