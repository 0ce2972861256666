"""The shared material beside the repository, and the rule that nothing else may be a reason to skip."""

import gc
import os
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

import cylforce  # before any test imports numpy: it sets the number of BLAS threads

# A busy machine makes no test fail, nor does chance: the examples are the same in every run.
settings.register_profile("cylforce", deadline=None, derandomize=True)
settings.load_profile("cylforce")
ROOT = Path(__file__).resolve().parents[1]
ABSENT = "no shared data: "
# The files that take longest, longest first: they are begun first, so that two processes end at about the same time.
LONGEST = (
    "test_wheel.py",
    "test_fleet_program.py",
    "test_diagnose.py",
    "test_unexplained_torque.py",
    "test_refused_recordings.py",
    "test_gap.py",
    "test_gap_first_use.py",
    "test_bad_input.py",
    "test_more_data.py",
    "test_reference_machine.py",
    "test_gap_input.py",
    "test_identification.py",
    "test_guidance.py",
    "test_checkup.py",
    "test_contract.py",
    "test_own_effect.py",
    "test_attacked.py",
    "test_withheld_trial.py",
    "test_interrupted.py",
    "test_crane_gap.py",
    "test_crane.py",
)


def pytest_report_header():
    return f"cylforce {cylforce.__version__}, BLAS threads: {os.environ['OPENBLAS_NUM_THREADS']}"


def pytest_addoption(parser):
    default = os.environ.get("CYLFORCE_SHARED", str(ROOT.parent / "shared"))
    parser.addoption("--shared", default=default, metavar="PATH", help=f"folder with data/ (now {default})")
    parser.addoption("--all", action="store_true", help="also the tests marked `long`: whole sweeps of studies")


def shared_folder(config):
    """The shared folder as given; whether it is there is for the caller to ask."""
    return Path(config.getoption("--shared")).resolve()


@pytest.fixture(scope="session")
def shared(request):
    """The shared folder, with data/ in it."""
    folder = shared_folder(request.config)
    if not (folder / "data").is_dir():
        pytest.skip(f"{ABSENT}{folder / 'data'} is absent (--shared PATH says where it is)")
    return folder


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    """The wheel as it would be published, the same for all processes of the run."""
    from wheels import built_wheel  # here, because a test runs this file alone in another folder

    own = tmp_path_factory.getbasetemp()
    return built_wheel(own.parent if "PYTEST_XDIST_WORKER" in os.environ else own)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    """What commands keep for the next time is not kept in the user's folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def pytest_configure(config):
    config.pluginmanager.register(Skips(config), "cylforce-skips")
    config.pluginmanager.register(Long(config), "cylforce-long")


def pytest_collection_modifyitems(items):
    place = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(LONGEST)))


def pytest_collection_finish():
    """What is collected stays until the end: the garbage collector need not look at it again and again."""
    gc.freeze()


class Long:
    """Leaves out tests marked `long` unless `--all` is given, and tells how many of which files these are."""

    def __init__(self, config):
        self.config = config
        self.left_out = {}

    def pytest_collection_modifyitems(self, items):
        if self.config.getoption("--all"):
            return
        long = [item for item in items if item.get_closest_marker("long")]
        items[:] = [item for item in items if item not in long]
        self.config.hook.pytest_deselected(items=long)
        self.left_out = dict(Counter(item.path.name for item in long))

    def pytest_sessionfinish(self):
        if hasattr(self.config, "workeroutput"):
            self.config.workeroutput["left_out"] = self.left_out

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        """Every process collects all tests."""
        self.left_out = self.left_out or getattr(node, "workeroutput", {}).get("left_out", {})

    def pytest_terminal_summary(self, terminalreporter):
        if self.left_out:
            files = ", ".join(f"{count} of {name}" for name, count in sorted(self.left_out.items()))
            line = f"{sum(self.left_out.values())} long tests did not run (--all runs them): {files}"
            terminalreporter.write_line(line, yellow=True, bold=True)


class Skips:
    """Counts what was skipped; a skip for any reason but absent shared data makes the run fail."""

    def __init__(self, config):
        self.folder = shared_folder(config)
        self.absent = 0
        self.forbidden = []

    def count(self, report):
        if not report.skipped or hasattr(report, "wasxfail"):
            return
        reason = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr)
        if ABSENT in reason:
            self.absent += 1
        else:
            self.forbidden.append(f"{report.nodeid}: {reason}")

    pytest_runtest_logreport = count
    pytest_collectreport = count

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session):
        if self.forbidden and session.exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter):
        if self.absent:
            terminalreporter.section("SHARED DATA ABSENT", red=True)
            plural = "" if self.absent == 1 else "s"
            line = f"{self.absent} test{plural} skipped: no ../shared/data ({self.folder / 'data'} is absent)"
            terminalreporter.write_line(line, red=True, bold=True)
        if self.forbidden:
            terminalreporter.section("FORBIDDEN SKIPS: the run has failed", red=True)
            for line in self.forbidden:
                terminalreporter.write_line(line)
