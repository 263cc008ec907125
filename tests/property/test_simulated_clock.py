import threading

from hypothesis import given
from hypothesis import strategies as st

from fieldkit.model.units import SECOND_NS
from fieldkit.simulation.simulated_clock import START_MONO_NS, SimulatedClock

naps = st.lists(st.floats(1e-9, 1e4), min_size=1, max_size=12)


@given(st.lists(naps, min_size=1, max_size=5))
def test_everybody_wakes_exactly_when_the_naps_add_up(crew):
    """Whatever the threads do, each wakes at its own times and time never runs back."""
    log = []
    joined = threading.Barrier(len(crew) + 1)
    with SimulatedClock(0) as clock:

        def work(name, seconds):
            with clock.taking_part():
                joined.wait()
                for nap in seconds:
                    clock.sleep(nap)
                    log.append((clock.mono_ns(), name))

        threads = [threading.Thread(target=work, args=args, name=str(args[0])) for args in enumerate(crew)]
        with clock.taking_part():
            for thread in threads:
                thread.start()
            joined.wait()
        for thread in threads:
            thread.join()
    assert [time_ns for time_ns, _ in log] == sorted(time_ns for time_ns, _ in log)
    for name, seconds in enumerate(crew):
        due, expected = START_MONO_NS, []
        for nap in seconds:
            due += round(nap * SECOND_NS)
            expected.append(due)
        assert [time_ns for time_ns, who in log if who == name] == expected
