"""Poses that a plan does without."""

import numpy as np

from planning.station.build import demo_station
from planning.welds import poses
from planning.welds.alternatives_search import alternatives
from sequencing.edges import pruning as module


def test_full_turns_and_dear_poses_go_and_the_loss_is_said(monkeypatch):
    station = demo_station("stud_welding_a_8")
    found = alternatives(station)
    assert module.pruned(station, found) == (found, None)
    monkeypatch.setattr(module, "MOST_POSES", 60)
    monkeypatch.setattr(module, "FEWEST", 3)
    kept, pruning = module.pruned(station, found)
    assert poses.MOST_POSES > pruning.poses == sum(len(item.alternatives) for item in found)
    assert pruning.kept == sum(len(item.alternatives) for item in kept) < pruning.poses
    assert 0.0 <= pruning.may_cost_percent < 50.0
    for before, after in zip(found, kept):
        assert after.alternatives
        assert set(after.alternatives) <= set(before.alternatives)
    middle = 0.5 * (station.robot.q_lower_rad + station.robot.q_upper_rad)
    middle = middle if station.home_rad is None else station.home_rad
    turning = station.robot.q_upper_rad - station.robot.q_lower_rad >= 2 * np.pi - 1e-9
    away = [abs(a.q_rad - middle)[turning].max() for k in kept for a in k.alternatives]
    assert max(away) <= np.pi + module.SEAM_RAD
