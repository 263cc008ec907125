"""How the lab counts losses, and when it lets one pass."""

import losses
import pytest
from losses import first_without_loss, nothing_lost, places_in, skipped


def test_pictures_are_found_in_order_and_the_missing_counted():
    assert places_in([7, 8, 8, 9], [7, 8, 9]) == [0, 1, 3]
    assert skipped([0, 1, 3]) == 1
    assert skipped([4, 5, 6]) == 0


@pytest.mark.parametrize("received", [[5], [8, 7]])
def test_a_picture_never_sent_or_out_of_order_is_an_error(received):
    with pytest.raises(ValueError, match="not in list"):
        places_in([7, 8], received)


def test_the_first_attempt_without_a_loss_counts(monkeypatch):
    monkeypatch.setattr(losses.os, "getloadavg", lambda: (0.0, 0.0, 0.0))  # an idle computer
    attempts = iter([("first", 2), ("second", 0), ("third", 0)])
    assert first_without_loss(lambda: next(attempts)) == "second"
    with pytest.raises(AssertionError):
        first_without_loss(lambda: ("again", 1))


@pytest.mark.parametrize(("load", "idle_share"), [(9.0, 1.0), (0.0, 0.0)])
def test_a_loss_without_processor_time_accuses_nobody(monkeypatch, load, idle_share):
    # an idle and a busy computer of two cores
    monkeypatch.setattr(losses.os, "getloadavg", lambda: (load, load, load))
    monkeypatch.setattr(losses.os, "cpu_count", lambda: 2)
    nothing_lost(0, idle_share)
    with pytest.raises(pytest.skip.Exception):
        nothing_lost(1, idle_share)
