"""Well-known pieces of work beside which a step is measured: an update of a Kalman filter of 14 states by 2 outputs of
filterpy, one of padasip's recursive least squares, the same in NumPy, and the Kalman filter's as a loop of C; a frame
through python-can and canopen."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import can
import canopen
import numpy as np
import padasip
from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable
from canopen.pdo.base import PdoMap
from filterpy.kalman import KalmanFilter

from cylforce.mechanics.installation import SensorNode, Service
from cylforce.signals.events import Frame
from cylforce.signals.layout import CODES

STATES, OUTPUTS = 14, 2
TYPES = {"b": 2, "B": 5, "h": 3, "H": 6, "i": 4, "I": 7, "f": 8}  # CiA 301, data types of an object dictionary
LOOP = r"""
enum { N = 14, M = 2 };
static double x[N], P[N][N], H[M][N];
void begin(void) { for (int i = 0; i < N; i++) { P[i][i] = 1; for (int m = 0; m < M; m++) H[m][i] = (i + m) % 3; } }
void update(int count) {
  while (count--) {
    double PH[N][M], S[M][M], K[N][M], y[M];
    for (int i = 0; i < N; i++) for (int m = 0; m < M; m++) {
      PH[i][m] = 0; for (int j = 0; j < N; j++) PH[i][m] += P[i][j] * H[m][j]; }
    for (int m = 0; m < M; m++) { y[m] = 1; for (int j = 0; j < N; j++) y[m] -= H[m][j] * x[j];
      for (int n = 0; n < M; n++) { S[m][n] = m == n; for (int j = 0; j < N; j++) S[m][n] += H[m][j] * PH[j][n]; } }
    double d = S[0][0] * S[1][1] - S[0][1] * S[1][0];
    for (int i = 0; i < N; i++) { K[i][0] = (PH[i][0] * S[1][1] - PH[i][1] * S[1][0]) / d;
      K[i][1] = (PH[i][1] * S[0][0] - PH[i][0] * S[0][1]) / d;
      for (int m = 0; m < M; m++) x[i] += K[i][m] * y[m]; }
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++)
      P[i][j] = (i == j) * 1e-3 + P[i][j] - K[i][0] * PH[j][0] - K[i][1] * PH[j][1];
  }
}
"""


def filterpy_update() -> Callable[[], object]:
    """One update by `filterpy.kalman.KalmanFilter`."""
    kalman = KalmanFilter(dim_x=STATES, dim_z=OUTPUTS)
    kalman.H = np.random.default_rng(0).normal(size=(OUTPUTS, STATES))
    seen = np.ones((OUTPUTS, 1))
    return lambda: kalman.update(seen)


def padasip_update() -> Callable[[], object]:
    """One adaption of `padasip.filters.FilterRLS` of 14 weights."""
    adaptive, row = padasip.filters.FilterRLS(n=STATES, mu=0.999), np.random.default_rng(0).normal(size=STATES)
    return lambda: adaptive.adapt(1.0, row)


def numpy_update() -> Callable[[], object]:
    """Recursive least squares of 14 weights, two outputs, in NumPy's own matrix products."""
    rows = np.random.default_rng(0).normal(size=(OUTPUTS, STATES))
    weights, spread, seen = np.zeros(STATES), np.eye(STATES), np.ones(OUTPUTS)

    def update() -> None:
        nonlocal weights, spread
        gain = np.linalg.solve(rows @ spread @ rows.T + np.eye(OUTPUTS), rows @ spread).T
        weights = weights + gain @ (seen - rows @ weights)
        spread = spread - gain @ (rows @ spread)

    return update


def c_updates(folder: Path, count: int) -> Callable[[], object] | None:
    """`count` updates of the Kalman filter by a loop of C; None without a compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    (folder / "loop.c").write_text(LOOP)
    command = [compiler, "-O2", "-shared", "-fPIC", str(folder / "loop.c"), "-o", str(folder / "loop.so")]
    subprocess.run(command, check=True)
    loop = ctypes.CDLL(str(folder / "loop.so"))
    loop.begin()
    return lambda: loop.update(count)


def canopen_decoder(service: Service) -> Callable[[Frame], object]:
    """A frame of a sensor as a message of python-can, its values by canopen's map of the PDO."""
    maps = {pdo_map.cob_id: pdo_map for node in service.nodes for pdo_map in _maps(node)}

    def decoded(frame: Frame) -> list[object]:
        message = can.Message(1e-6 * frame.t_us, frame.can_id, is_extended_id=False, data=frame.data)
        found = maps[message.arbitration_id]
        found.on_message(message.arbitration_id, message.data, message.timestamp)
        return [variable.phys for variable in found.map]

    return decoded


def _maps(node: SensorNode) -> list[PdoMap]:
    objects = ObjectDictionary()
    for pdo in node.pdos:
        record = ODRecord(f"values {pdo.number}", 0x2000 + pdo.number)
        for k, field in enumerate(pdo.fields, 1):
            variable = ODVariable(field.signal or f"unused {k}", record.index, k)
            variable.data_type, variable.factor = TYPES[field.code], field.scale
            record.add_member(variable)
        objects.add_object(record)
    remote, found = canopen.RemoteNode(node.node_id, objects), []
    for pdo in node.pdos:
        made = PdoMap(remote.tpdo, None, None)
        made.cob_id = pdo.can_id
        for k, field in enumerate(pdo.fields, 1):
            made.add_variable(0x2000 + pdo.number, k, 8 * CODES[field.code])
        found.append(made)
    return found
