"""What was learnt of a healthy machine, as arrays in a file: beside identified.toml, and in the cache of references."""

import zipfile
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cylforce
from cylforce.diagnosis.likelihood import MachineKnowledge, ResidualNoise
from cylforce.diagnosis.model import ColumnLayout, HealthyMachine, KnowledgeSource
from cylforce.diagnosis.regressors import Regressors, ReturnLaw
from cylforce.diagnosis.statistics import NoiseFloor
from cylforce.effects.library import Proposal
from cylforce.estimation.model import Model, Tares
from cylforce.files.atomic import replacing
from cylforce.settings.machine_file import Loaded

FORMAT = 1
AGAIN = "identify again (cylforce identify)"
Arrays = Mapping[str, NDArray[Any]]


def statistics_path(identified: Path) -> Path:
    """Return where the statistics of an identified.toml stand: identified.statistics.npz."""
    return identified.with_name(f"{identified.stem}.statistics.npz")


def write_statistics(path: Path, machine: HealthyMachine, loaded: Loaded, tares: Tares) -> None:
    """Write the statistics of an identified machine, whole or not at all."""
    origin = _origin(loaded, tares, machine.layout.proposals)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **origin, **arrays_of(machine))


def read_statistics(
    path: Path, loaded: Loaded, tares: Tares, proposals: tuple[Proposal, ...]
) -> tuple[HealthyMachine | None, str]:
    """Return the statistics of an identified machine; None with the reason and the cure where they do not fit."""
    if not path.exists():
        return None, f"{path} is missing, so that only the parameters of the identification are known: {AGAIN}"
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = dict(file)
        for name, value in _origin(loaded, tares, proposals).items():
            if not np.array_equal(arrays[name], value):
                return None, f"{path}: {_REASONS[name]}, so that its statistics are not used: {AGAIN}"
        return machine_of(arrays, Model(loaded.service.machine, loaded.service.filters, ()), proposals), ""
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None, f"{path}: is no file of statistics, or broken, and not used: {AGAIN}"


_REASONS = {
    "format": "is of another format",
    "version": "was written by another version of cylforce",
    "machine_sha256": "belongs to another machine file",
    "tares_sha256": "belongs to another identification",
    "library_sha256": "was made with other effects",
    "rate_hz": "was made at another sampling rate",
}


def _origin(loaded: Loaded, tares: Tares, proposals: Sequence[Proposal]) -> dict[str, NDArray[Any]]:
    """Return what statistics belong to, by name."""
    return {
        "format": np.array(FORMAT),
        "version": np.array(cylforce.__version__),
        "machine_sha256": np.array(loaded.sha256),
        "tares_sha256": np.array(hash_of_tares(tares)),
        "library_sha256": np.array(hash_of_proposals(proposals)),
        "rate_hz": np.array(loaded.service.filters.rate_hz),
    }


def hash_of_tares(tares: Tares) -> str:
    """Return the SHA-256 of identified parameters: names, values and covariance."""
    said = repr((tares.friction, tares.names)).encode()
    return sha256(b"\0".join([said, tares.values.tobytes(), np.asarray(tares.covariance).tobytes()])).hexdigest()


def hash_of_proposals(proposals: Sequence[Proposal]) -> str:
    """Return the SHA-256 of a library at its places: names, places and shapes of its effects."""
    said = [(p.name, p.at, [(type(e).__name__, repr(e)) for e in p.group]) for p in proposals]
    return sha256(repr(said).encode()).hexdigest()


def arrays_of(machine: HealthyMachine) -> dict[str, NDArray[Any]]:
    """Return a healthy machine as arrays, without its model."""
    known, noise, floor = machine.machine, machine.machine.noise, machine.floor
    sensors = sorted(machine.returns)
    laws = [machine.returns[k] for k in sensors]
    return {
        "friction": np.array(machine.regressors.model.friction, dtype=np.str_),
        "parameters": machine.regressors.parameters,
        "base_moves": np.array(machine.layout.base_moves),
        "source": np.array(machine.source.value),
        "floor_rms": floor.rms,
        "floor_memory": floor.memory,
        "floor_white": floor.white,
        "known": machine.known,
        "mean": known.mean,
        "covariance_root": _root(known.covariance).astype(np.float32),
        "variation": known.variation,
        "discrepancy": noise.discrepancy,
        "white": noise.white,
        "width": noise.width,
        "values": machine.values,
        "floor_seen": machine.floor_seen,
        "floor_unseen": machine.floor_unseen,
        "regimes": np.zeros((0, 0)) if machine.regimes is None else machine.regimes,
        "sensor_noise": machine.sensor_noise,
        "base_rate": np.array(machine.base_rate),
        "references": np.array(machine.references),
        "loaded": np.array(machine.loaded),
        "return_sensors": np.array(sensors, dtype=np.int64),
        "return_values": np.array([law.values for law in laws]),
        "return_covariances": np.array([law.covariance for law in laws]),
        "return_scatters": np.array([law.scatter for law in laws]),
    }


def machine_of(arrays: Arrays, model: Model, proposals: tuple[Proposal, ...]) -> HealthyMachine:
    """Return the healthy machine of arrays; the friction laws of the model are theirs."""
    model = model.with_laws(tuple(str(law) for law in arrays["friction"]))
    layout = ColumnLayout(model, proposals, bool(arrays["base_moves"]))
    regressors = Regressors(model, arrays["parameters"])
    if len(arrays["mean"]) != layout.size or len(arrays["parameters"]) != len(model.parameters):
        raise ValueError("the statistics have other columns than this model")
    laws = zip(arrays["return_values"], arrays["return_covariances"], arrays["return_scatters"].tolist(), strict=True)
    root = arrays["covariance_root"].astype(np.float64)
    returns = {int(k): ReturnLaw(*law) for k, law in zip(arrays["return_sensors"], laws, strict=True)}
    return HealthyMachine(
        regressors,
        layout,
        KnowledgeSource(str(arrays["source"])),
        NoiseFloor(arrays["floor_rms"], arrays["floor_memory"], arrays["floor_white"]),
        arrays["known"],
        MachineKnowledge(
            arrays["mean"],
            np.asarray(root @ root.T),
            arrays["variation"],
            ResidualNoise(arrays["discrepancy"], arrays["white"], arrays["width"]),
        ),
        arrays["values"],
        arrays["floor_seen"],
        arrays["floor_unseen"],
        arrays["regimes"] if arrays["regimes"].size else None,
        arrays["sensor_noise"],
        float(arrays["base_rate"]),
        int(arrays["references"]),
        bool(arrays["loaded"]),
        returns,
    )


def _root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return R with R R' = covariance (K, K).

    In single precision R keeps small eigenvalues that the covariance itself would lose.
    """
    unit = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return np.asarray(unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
