"""Other tools on the same arm: the machine file's attachments, their tares, the choice, and a tool that is another one
than was chosen."""

import io
import struct
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from cylforce.commissioning.guidance import Guide, Judgement
from cylforce.commissioning.identification import Identification, attachment_prior, identify_attachment
from cylforce.estimation.attachment import tool_of, with_tool
from cylforce.estimation.model import Tares
from cylforce.estimation.priors.bars import represented
from cylforce.files.atomic import RecordingError
from cylforce.files.checkpoint import packed, unpacked
from cylforce.mechanics.machine import base_parameters
from cylforce.programs import sim
from cylforce.programs.common.play import prepare
from cylforce.programs.common.readings import make_core, model_of, tool_models
from cylforce.programs.identify import How, run_identify, show
from cylforce.programs.live.books import changed
from cylforce.programs.sim import START_US
from cylforce.service import commands
from cylforce.service.booking import Missed, MissedReason, Weighed
from cylforce.service.commands import Scale
from cylforce.service.core import Core
from cylforce.service.loading.truck import Truck
from cylforce.service.memory import Memory
from cylforce.service.service import WeighingService
from cylforce.service.tool_check import ToolCheck
from cylforce.settings.identified import read_attachments, read_identified, write_attachment, write_identified
from cylforce.settings.machine_file import SettingsError, load
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.events import Frame, Tick
from cylforce.simulation.sensor_bus import bus_events
from scenarios import EXCAVATOR, GRAB, fed


def written(folder, text=GRAB):
    path = folder / "machine.toml"
    path.write_text(EXCAVATOR.read_text() + text)
    return load(path)


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    return written(tmp_path_factory.mktemp("grab"))


@pytest.fixture(scope="module")
def tares(loaded):
    """As if the recording had shown every parameter to a thousandth of what the data sheet leaves."""
    model = model_of(loaded)
    sheet = model.data_sheet
    return sheet._replace(covariance=1e-6 * sheet.covariance, identified=True, row_error=np.full(3, 60.0))


@pytest.fixture(scope="module")
def minute(loaded):
    """A minute of the simulated machine with a grab that is 10 % off its data sheet."""
    service = loaded.service
    play = prepare(loaded._replace(service=service.fitted("grab")), "moves", 3, 0.1, amount=40.0)
    return play.truth, [record.values for record in play.records]


@pytest.fixture(scope="module")
def core(loaded, tares):
    return Core(loaded.service, tares, {"grab": with_tool(tares, *tool_models(loaded, "grab", tares))})


class TestMachineFile:
    def test_an_attachment_takes_the_last_links_place(self, loaded):
        service = loaded.service
        grab = service.fitted("grab").machine
        assert service.tools == ("standard", "grab")
        assert (grab.links[-1].mass, grab.tool, grab.rated_payload, grab.payload_reach) == (1100.0, 1.6, 1300.0, 1.6)
        assert grab.links[:-1] == service.machine.links[:-1]
        assert grab.links[-1].angle_low == service.machine.links[-1].angle_low

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ('name = "grab"', 'name = "standard"', "attachments.standard.name is 'standard', which is taken"),
            ('kind = "grab"', 'kind = "crab"', "attachments.grab.kind must be 'bucket', 'grab' or 'fork', not 'crab'"),
            ("mass_kg = 1100", "mass_kg = 1.1e6", "attachments.grab.mass_kg"),
            ("mass_kg = 1100\n", "", "attachments.grab lacks the key mass_kg: add it"),
            ("centre_m = [0.75, 0.2]", "centre_m = [4.0, 0.2]", "attachments.grab.centre_m is 2.5 of the length away"),
            ("rated_payload_kg = 1300", "rated_payload_kg = 1e6", "attachments.grab.rated_payload_kg"),
            ("rated_payload_kg", "rated_paylod_kg", "did you mean rated_payload_kg"),
        ],
    )
    def test_what_is_wrong_is_said_with_line_and_key(self, tmp_path, old, new, words):
        with pytest.raises(SettingsError) as error:
            written(tmp_path, GRAB.replace(old, new))
        assert words in str(error.value)

    def test_a_tool_that_is_not_there(self, loaded):
        with pytest.raises(ValueError, match=r"fork: is no attachment of .*: use one of standard, grab"):
            loaded.service.fitted("fork")


class TestTares:
    def test_taking_one_tool_off_and_the_other_on_gives_the_others_parameters(self, loaded, tares):
        """With the data sheet's own values the result is the other data sheet."""
        found = with_tool(tares, *tool_models(loaded, "grab", tares))
        grab = loaded.service.fitted("grab").machine
        wanted = base_parameters(grab.links)
        links = represented(grab, found.names) @ found.values
        np.testing.assert_allclose(links[: len(wanted)], wanted, rtol=1e-9, atol=1e-6)

    def test_the_standard_error_is_that_of_the_data_sheet(self, loaded, tares):
        standard, other = tool_models(loaded, "grab", tares)
        found, new = with_tool(tares, standard, other), tool_of(other.machine.links[-1])
        place = found.names.index("bucket.X")
        assert found.covariance[place, place] == pytest.approx(new.covariance[1, 1], rel=1e-3)
        assert np.linalg.eigvalsh(found.covariance)[0] > 0.0

    def test_what_the_standard_tool_weighs_on_the_inner_links_is_taken_off_as_identified(self, loaded, tares):
        """A bucket of other mass: its weight on the boom goes with it, as far as its own first moment tells it."""
        standard, other = tool_models(loaded, "grab", tares)
        bucket = standard.machine.links[-1]
        heavier = replace(bucket, mass=1.1 * bucket.mass, inertia=1.1 * bucket.inertia)
        links = represented(standard.machine, tares.names) @ tares.values
        values = tares.values.copy()
        values[:9] += base_parameters((*standard.machine.links[:-1], heavier)) - links[:9]
        found = with_tool(tares._replace(values=values), standard, other)
        wanted = base_parameters(other.machine.links)
        place = found.names.index("boom.X")
        apart = abs((represented(other.machine, found.names) @ found.values)[place] - wanted[place])
        assert apart < 0.7 * 0.1 * bucket.mass * standard.machine.links[0].length
        assert apart < 2.0 * np.sqrt(found.covariance[place, place])

    def test_a_minute_of_empty_motion_is_enough(self, loaded, minute):
        """The arm is known from elsewhere; what the grab weighs comes from its own motion."""
        truth, segments = minute
        grab = truth.links[-1]
        bucket = loaded.service.machine.links[-1]
        common = model_of(loaded).data_sheet
        values, spread = common.values.copy(), common.covariance.copy()
        values[:9] = base_parameters((*truth.links[:-1], bucket))
        spread[:9, :9] = np.diag((1e-3 * values[:9]) ** 2 + 1.0)
        known = common._replace(values=values, covariance=spread, identified=True)
        found = identify_attachment(known, *tool_models(loaded, "grab", known), segments).tares
        place = found.names.index("bucket.X")
        error = np.sqrt(found.covariance[place, place])
        assert found.values[place] == pytest.approx(grab.mass * grab.cx, abs=0.01 * 1300 * 1.6)
        assert error < 0.01 * 1300 * 1.6 < np.sqrt(tool_of(grab).covariance[1, 1])


def identified_file(path, loaded, tares):
    model = tool_models(loaded, "standard", tares)[0]
    found = Identification(model, tares, None, (), 60.0, {}, (), np.ones(3), ())
    write_identified(path, found, loaded, [("empty.log", "0" * 64)])


class TestCommands:
    def test_the_simulated_machine_with_the_tool_is_identified_into_the_same_file(self, tmp_path, loaded, tares):
        """What `sim --attachment`, `identify --attachment` and `replay --identified` do."""
        path, table = tmp_path / "identified.toml", tmp_path / "grab.csv"
        identified_file(path, loaded, tares)
        sim.run_sim(loaded.path, scenario="moves", duration=40.0, seed=3, attachment="grab", table=table)
        found = run_identify(loaded, [table], path, How(attachment="grab"))
        show(found, Console(file=io.StringIO()))
        np.testing.assert_array_equal(read_attachments(path, loaded)["grab"].values, found.tares.values)

    def test_what_does_not_go_together_is_refused(self, tmp_path, loaded):
        how = How(attachment="grab", lift=tmp_path / "lift.csv", known_kg=1000.0)
        table = tmp_path / "t.csv"
        table.write_text("t_s\n0\n")
        with pytest.raises(RecordingError, match="--attachment: takes scale and laws from the standard tool"):
            run_identify(loaded, [table], tmp_path / "identified.toml", how)

    def test_without_the_standard_tools_tares_there_is_no_arm_to_begin_from(self, tmp_path, loaded):
        table = tmp_path / "t.csv"
        table.write_text("t_s\n0\n")
        with pytest.raises(SettingsError, match=r"cannot be read .*; run `cylforce identify` first"):
            run_identify(loaded, [table], tmp_path / "absent.toml", How(attachment="grab"))

    def test_the_guidance_ends_after_a_minute(self, loaded):
        """The arm is known: missing strokes are asked for up to a minute, not for four and a half."""
        common = model_of(loaded).data_sheet
        known = common._replace(covariance=1e-6 * common.covariance, identified=True)
        standard, other = tool_models(loaded, "grab", known)
        guide = Guide(other, 5.0, attachment_prior(known, standard, other))
        state = guide.begin()._replace(moved_s=61.0, judgement=Judgement(5.0, None))
        assert guide.advice(state).done
        assert not guide.advice(state._replace(moved_s=59.0)).done
        assert not Guide(other, 5.0).advice(state).done


class TestFile:
    def test_the_file_holds_the_tares_of_each_attachment(self, tmp_path, loaded, tares):
        path = tmp_path / "identified.toml"
        identified_file(path, loaded, tares)
        assert read_attachments(path, loaded) == {}
        other = tares._replace(values=1.01 * tares.values)
        for made in (tares, other):  # the second replaces the first
            write_attachment(path, "grab", made, loaded, [("grab.log", "1" * 64)])
        found = read_attachments(path, loaded)["grab"]
        np.testing.assert_array_equal(found.values, other.values)
        np.testing.assert_array_equal(read_identified(path, loaded).values, tares.values)
        core = make_core(loaded, path)
        np.testing.assert_array_equal(core.fitted["grab"].tares.values, other.values)

    def test_without_its_own_tares_the_data_sheet_counts(self, tmp_path, loaded, tares):
        path = tmp_path / "identified.toml"
        identified_file(path, loaded, tares)
        found = make_core(loaded, path).fitted["grab"].tares
        assert isinstance(found, Tares)
        np.testing.assert_allclose(
            found.values, with_tool(tares, *tool_models(loaded, "grab", tares)).values, rtol=1e-12
        )

    def test_an_attachment_that_is_not_in_the_machine_file_is_refused(self, tmp_path, loaded, tares):
        path = tmp_path / "identified.toml"
        identified_file(path, loaded, tares)
        write_attachment(path, "crab", tares, loaded, [])
        with pytest.raises(SettingsError, match=r"crab is none of .*machine.toml; identify it again"):
            make_core(loaded, path)


class TestChoice:
    def chosen(self, core, number, state=None):
        state = WeighingService.start(core, Memory(Scale(3.0, 50.0), Truck(4, 9000.0, 1))) if state is None else state
        data = struct.pack("<BHBI", 0x23, commands.LOADING, commands.TOOL, number)
        return state, fed(state, Frame(1, 0x600 + core.service.node_id, data))

    def test_another_tool_is_another_core_and_the_truck_stays(self, core):
        state, out = self.chosen(core, 1)
        assert (out.verdict, out.words) == (0, "attachment grab chosen: zero and tare are 0")
        assert state.memory == Memory(Scale(), Truck(4, 9000.0, 1), None, "grab")
        fed(state, Tick(START_US))
        assert state.tool == "grab"

    def test_the_same_once_more_changes_nothing(self, core):
        state, _ = self.chosen(core, 1)
        before = packed(state.snapshot())
        _, out = self.chosen(core, 1, state)
        assert packed(state.snapshot()) == before
        assert out.words == "attachment grab is chosen already"

    def test_a_number_that_is_none_is_refused_in_words(self, core):
        state, out = self.chosen(core, 2)
        assert state.tool == "standard"
        assert (out.verdict, out.words) == (
            commands.OUT_OF_RANGE,
            "attachment refused: 2 is none of 0 standard, 1 grab",
        )

    def test_the_choice_survives_a_restart(self, core):
        state, _ = self.chosen(core, 1)
        again = WeighingService.start(core, unpacked(Memory, packed(state.memory)))
        assert again.memory == state.memory
        assert again.load.lift.root.factor.shape == state.load.lift.root.factor.shape

    def test_a_load_that_was_weighed_with_other_tares_or_long_ago_is_told_as_not_booked(self, core):
        hung = Weighed(900.0, 4.0, np.zeros(2), np.zeros(1), 300)
        for kept in (Memory(hanging=hung), Memory(hanging=hung).emptied()):
            state = WeighingService.start(core, kept)
            assert state.bookings.missed == Missed(1, 900.0, MissedReason.INTERRUPTED)
            assert state.memory == Memory()
            assert changed(kept, state.memory)

    def test_a_tool_that_the_machine_file_no_longer_has_is_the_standard_one(self, core):
        assert WeighingService.start(core, Memory(tool="fork")).tool == "standard"


def weights(*given, limit=75.0):
    """The check after settled weights: a number, or a number that no load can have."""
    check, found = ToolCheck(), []
    for mass in given:
        check.take(mass, limit, empty=abs(mass) <= limit, impossible=mass < -limit)
        found.append(check.empty_weight)
    return found


class TestOtherTool:
    @pytest.mark.parametrize(
        ("given", "off"),
        [
            ((0.0, 900.0, 10.0, 800.0), [None] * 4),  # the right tool
            ((900.0, 10.0, 800.0), [None] * 3),  # the service starts with a load
            ((240.0, 1100.0, 240.0, 900.0), [None, 240.0, 240.0, 240.0]),  # heavier than its tares
            ((0.0, 240.0, 1100.0, 240.0, 900.0), [None] * 4 + [240.0]),  # changed, and nobody said so
            ((-240.0, 700.0), [-240.0, -240.0]),  # lighter
            ((240.0, 1100.0, 0.0), [None, 240.0, None]),  # dirt that fell off
            ((0.0, 400.0, 900.0, 450.0, 5.0, 700.0), [None] * 6),  # filled twice, dumped twice
            ((500.0, 1000.0, 1500.0), [None, 500.0, None]),  # a load that grows twice
            ((0.0, 900.0, 600.0, 1000.0), [None] * 4),  # a part was put back, and it was filled once more
            ((240.0, 700.0, 1100.0, 240.0, 900.0), [None, 240.0, None, None, 240.0]),  # heavier, filled twice
            ((240.0, 1100.0, 240.0, 700.0, 1100.0), [None] + [240.0] * 4),  # it has returned to 240 kg: no load does
            ((-240.0, 300.0, 700.0), [-240.0] * 3),  # lighter, filled twice
        ],
    )
    def test_the_empty_tool_off_zero(self, given, off):
        assert weights(*given) == off

    @pytest.mark.parametrize("factor", [0.7, 1.3])
    def test_another_bucket_is_told_before_anything_is_booked(self, loaded, factor):
        """The tares are those of the bucket of the machine file, the machine has one 30 % lighter or heavier."""
        service = loaded.service
        bucket = service.machine.links[-1]
        changed = replace(bucket, mass=factor * bucket.mass, cx=bucket.cx + 0.1 * np.sign(factor - 1.0))
        other = service._replace(machine=replace(service.machine, links=(*service.machine.links[:-1], changed)))
        play = prepare(loaded._replace(service=other), "cycles", 3, 0.0, amount=1)
        events = bus_events(other, play.made, list(play.records), START_US, np.random.default_rng(3))
        sheet = model_of(loaded).data_sheet
        known = sheet._replace(covariance=1e-4 * sheet.covariance, identified=True, row_error=np.full(3, 300.0))
        core = Core(service, known)
        state = WeighingService.start(core)
        for event in events:
            fed(state, event)
            if state.tool_check.empty_weight is not None:
                break
        assert state.tool_check.empty_weight == pytest.approx((factor - 1.0) * bucket.mass, rel=0.3)
        assert state.estimate.gross.reason is Reason.OTHER_TOOL
        assert state.estimate.gross.status is not Status.OK
        assert state.estimate.booking is None
