"""Short form of `python -m tests.qa.long_haul`: figures, refusals, and a stop that changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from tests.qa.long_haul import SAMPLES, Haul, LongHaul, actions

pytestmark = pytest.mark.slow  # tens of thousands of decisions

TIMED = ("decisions_per_s", "last_tenth_over_first", "resident_mb", "bytes_per_million_decisions")


def haul(path, **changes) -> Haul:
    return Haul(LongHaul(**({"decisions": 64 * SAMPLES * 2, "envs": 64, "output": path / "haul.json"} | changes)))


def results(run: Haul) -> dict:
    return {name: value for name, value in run.figures().items() if name not in TIMED}


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Haul:
    run = haul(tmp_path_factory.mktemp("whole"))
    run.run()
    return run


def test_episodes_end_both_ways_and_memory_stays(whole):
    """Half the environments are driven hard."""
    drawn = actions(np.random.default_rng(0), (10, 3))
    assert set(np.abs(drawn[::2]).ravel()) == {1.0}
    assert 0.0 < np.abs(drawn[1::2]).max() <= 0.05
    figures = whole.figures()
    assert figures["decisions"] == 64 * SAMPLES * 2
    assert 0 < figures["terminated"] < figures["episodes"]
    assert abs(figures["resident_mb"]["last"] - figures["resident_mb"]["first"]) < 20.0
    assert len(whole.seen["samples"]) == SAMPLES


def test_a_stopped_run_resumes_with_the_same_result(whole, tmp_path, monkeypatch):
    stopped, step = haul(tmp_path), Haul._step

    def interrupted(self, drawn):
        step(self, drawn)
        if self.steps == 150:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Haul, "_step", interrupted)
        with pytest.raises(KeyboardInterrupt):
            stopped.run()
    resumed = haul(tmp_path, resume=True)
    assert 100 < resumed.steps < 150  # the last that was kept
    resumed.run()
    assert results(resumed) == results(whole)


def test_what_is_not_finite_stops_the_run(tmp_path):
    run = haul(tmp_path)
    run.env.fleet.rows.plants["rate"][7] = np.nan
    run.env.fleet.rows.plants["momentum"][7] = np.nan
    with pytest.raises(FloatingPointError):
        run.run()


def test_resume_needs_a_run_with_the_same_settings(tmp_path):
    with pytest.raises(ValueError, match="there is no run to resume"):
        haul(tmp_path, resume=True)
    kept = haul(tmp_path)
    kept._save()
    with pytest.raises(ValueError, match="of a run with other settings"):
        haul(tmp_path, resume=True, seed=1)
    with pytest.raises(ValueError, match="decisions must be an integer of at least 12800"):
        haul(tmp_path, decisions=100)
