"""A real crane: tares identified from one run, all other runs predicted, and nothing found on its empty hook.

The marks are those of the recordings' own README; what each figure is, tools/crane/measure.py says."""

import pytest

from crane_figures import figures_of, measure

RATED_KG = 1000.0
TWO_JOINTS = ("Dual1SineRun", "Dual2SineTest", "Dual2SineTestFlowShare")


@pytest.fixture(scope="module")
def figures(shared, tmp_path_factory):
    return figures_of("crane.figures", shared, tmp_path_factory.mktemp("crane"))


@pytest.mark.parametrize(("joint", "reach_n_m"), [("boom", 320.0), ("jib", 400.0)])
def test_unexplained_torque_of_the_runs_that_were_not_fitted(figures, joint, reach_n_m):
    assert figures["unexplained_n_m"]["identified"][joint] < reach_n_m


def test_the_data_sheet_alone_leaves_ten_times_as_much_at_the_boom(figures):
    left = figures["unexplained_n_m"]
    assert left["identified"]["boom"] < left["data sheet"]["boom"] / 10.0


def test_a_joint_that_stands_still_is_not_scored(figures):
    by_run = figures["unexplained_by_run_n_m"]
    assert by_run["JibSineTest"]["boom"] is None
    assert by_run["MainSineTest"]["jib"] is None
    assert by_run["JibSineTest"]["jib"] < 400.0
    assert by_run["MainSineTest"]["boom"] < 320.0


def test_both_cylinders_tell_the_same_gravity_moment_of_the_jib(figures):
    """Independent pressure sensors on two cylinders: about two percent, says the README."""
    assert figures["jib_gravity_moment"]["difference_percent"] < 3.0
    assert figures["jib_gravity_moment"]["difference_both_moving_percent"] < 1.5


def test_the_empty_crane_weighs_nothing(figures):
    weight = figures["weight"]["others"]
    assert abs(weight["mean_kg"]) < 0.02 * RATED_KG
    assert weight["standard_deviation_kg"] < 0.02 * RATED_KG


@pytest.mark.parametrize("run", TWO_JOINTS)
def test_a_run_that_moves_both_joints_is_weighed(figures, run):
    weight = figures["weight"][run]
    assert weight["ok_share"] > 0.5
    assert abs(weight["mean_kg"]) < 0.02 * RATED_KG


@pytest.mark.parametrize("run", ["JibSineTest", "MainSineTest"])
def test_a_joint_that_rests_on_its_friction_is_never_ok(figures, run):
    """Nobody knows the friction of a cylinder that stands still: no weight is OK, and the warning is a fair one."""
    weight = figures["weight"][run]
    assert weight["ok_share"] == 0.0
    assert abs(weight["degraded_mean_kg"]) < 2.0 * weight["degraded_published_kg"]


def test_a_folder_without_recordings_is_refused_with_a_sentence(tmp_path):
    done = measure("crane.figures", tmp_path, tmp_path / "figures.json")
    assert done.returncode == 2
    assert done.stderr.startswith("crane_figures: ")
    assert "model_parameters.json" in done.stderr
