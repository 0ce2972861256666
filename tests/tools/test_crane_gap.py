"""A real crane against its data sheet: what is named, how far that holds on runs that were not seen, and clocks that
part. (What is measured, and how: tools/crane/gaps.py.)"""

import pytest

from crane_figures import figures_of, measure

SLIPPED = ("boom_head_pressure", "jib_head_pressure", "jib_rod_pressure")
ONE_RUN = pytest.mark.xfail(
    strict=True,
    reason="96.8 %: the jib's moments of this run are not those of the others; least squares closes 96.9 %",
)
SHEETS = ("data sheet", "data sheet, Dual1SineRun", "data sheet, all runs")
MASSES = {"boom.X", "boom.Z", "jib.X", "jib.Z"}
DRY_FRICTION = {"boom.coulomb", "jib.coulomb"}
RUNS = ("JibSineTest", "Dual1SineRun", "Dual2SineTest", "Dual2SineTestFlowShare")
TRAPS = ("clocks drift apart, four runs", "clocks drift apart, Dual1SineRun")


@pytest.fixture(scope="module")
def figures(shared, tmp_path_factory):
    return figures_of("crane.gaps", shared, tmp_path_factory.mktemp("crane"), "--quick")


def parameters_of(figures, asked):
    """Parameters of the data sheet that the answer says are wrong, by name."""
    return {each["name"]: each for each in figures["answers"][asked]["parameters"]}


@pytest.mark.parametrize("asked", SHEETS)
def test_moments_of_both_links_and_dry_friction_of_both_cylinders_are_named_without_being_told(figures, asked):
    assert set(parameters_of(figures, asked)) >= MASSES | DRY_FRICTION


@pytest.mark.parametrize("asked", SHEETS)
def test_no_effect_is_named_where_only_the_data_sheet_is_known(figures, asked):
    assert not figures["answers"][asked]["causes"]
    assert figures["answers"][asked]["sentence"].startswith("Identify the machine first")


@pytest.mark.parametrize("asked", SHEETS)
def test_sizes_are_those_of_least_squares(figures, asked):
    """The data's README: about 3.4 kN of dry friction each, and a jib whose moments are 190 kg m more, 137 less."""
    found = parameters_of(figures, asked)
    assert all(3000.0 < found[name]["after"] < 4500.0 for name in DRY_FRICTION)
    assert found["jib.X"]["after"] - found["jib.X"]["before"] == pytest.approx(190.0, abs=60.0)
    assert found["jib.Z"]["after"] - found["jib.Z"]["before"] == pytest.approx(-137.0, abs=60.0)


@pytest.mark.parametrize("joint", ["boom", "jib"])
def test_the_gap_is_closed_on_runs_that_were_not_seen(figures, joint):
    assert figures["unseen"]["all four so, together"]["closed_percent"][joint] >= 97.0
    each = [figures["unseen"][f"{run}, by the other three"]["closed_percent"].get(joint) for run in RUNS]
    assert all(closed > 95.0 for closed in each if closed is not None)


def test_names_do_not_hang_on_one_run(figures):
    """Whichever run is left out, the same parameters are named."""
    named = {tuple(figures["unseen"][f"{run}, by the other three"]["names"]) for run in RUNS}
    assert named == {tuple(sorted(MASSES | DRY_FRICTION))}


@pytest.mark.parametrize("trap", TRAPS)
def test_pressures_paired_by_number_are_no_physical_effect(figures, trap):
    answer = figures["answers"][trap]
    assert answer["verdict"] in ("explained", "unknown")
    assert {cause["name"] for cause in answer["causes"]} <= {"clock_fault"}
    assert "pressures and angles that were recorded on different clocks" in answer["sentence"]


def test_the_booms_gap_is_closed_on_other_runs_by_one(figures):
    assert figures["unseen"]["the other three, by Dual1SineRun"]["closed_percent"]["boom"] >= 97.0


@ONE_RUN
def test_the_jibs_gap_is_closed_on_other_runs_by_one(figures):
    assert figures["unseen"]["the other three, by Dual1SineRun"]["closed_percent"]["jib"] >= 97.0


def test_no_clock_is_named_on_runs_in_order(figures):
    order = {name: found for name, found in figures["clocks"].items() if "fault" not in name}
    assert len(order) == 7
    assert not any(order.values())


def test_the_time_base_fault_is_found_in_single_runs_with_its_sensors(figures):
    """Three pressures at half speed, one right. A run in which only the jib strokes at one speed tells too little."""
    told = {name: found for name, found in figures["clocks"].items() if "fault" in name and found}
    assert len(told) >= 6
    for name, (slip,) in told.items():
        moving = {s for s in SLIPPED if ("jib" if name.startswith("Jib") else "boom") in s or name.startswith("Dual")}
        assert set(slip["sensors"]) == moving, name


@pytest.mark.parametrize("trap", TRAPS)
def test_the_lag_that_is_told_is_the_one_that_was_made(figures, trap):
    """Pressures of 5 ms beside positions of 10 ms: what belongs to t is found at 2 t, as long as there is any."""
    (cause,) = figures["answers"][trap]["causes"]
    assert cause["sizes"][0] == pytest.approx(30.0, abs=2.0)


def test_a_folder_without_recordings_is_refused_with_a_sentence(tmp_path):
    done = measure("crane.gaps", tmp_path, tmp_path / "gaps.json", "--quick")
    assert done.returncode == 2
    assert done.stderr.startswith("crane_gap: ")
