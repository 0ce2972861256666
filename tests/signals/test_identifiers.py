"""Identifiers of our PDOs: only those that CiA 301 leaves to PDOs, and each of them once."""

from pathlib import Path

import pytest

from cylforce.service.publication import BASES, cob_id, publication
from cylforce.settings.bus import nodes
from cylforce.settings.error import Inspection
from cylforce.settings.machine_file import load
from cylforce.settings.model import MachineFile
from cylforce.signals.identifiers import EMCY, HEARTBEAT, SDO_REQUEST, SDO_RESPONSE, is_of_a_pdo
from scenarios import EXCAVATOR

NODE_IDS = range(1, 128)


@pytest.mark.parametrize("can_id", [0x181, 0x57F, 0x680, 0x6DF])
def test_a_pdo_may_have_the_first_and_last_identifiers_of_both_ranges(can_id):
    assert is_of_a_pdo(can_id)


@pytest.mark.parametrize("can_id", [0x000, 0x080, 0x180, 0x580, 0x601, 0x67F, 0x6E0, 0x701, 0x7FF])
def test_a_pdo_may_not_have_an_identifier_of_other_messages(can_id):
    assert not is_of_a_pdo(can_id)


def test_our_pdos_have_identifiers_of_pdos_whatever_our_node_id():
    for node_id in NODE_IDS:
        found = [pdo.can_id for pdo in publication(node_id, 0.05, 1500.0, 300e3)]
        assert len(set(found)) == len(found) == len(BASES)
        assert all(map(is_of_a_pdo, found))
        assert not {base + node_id for base in (EMCY, SDO_RESPONSE, SDO_REQUEST, HEARTBEAT)} & set(found)


@pytest.mark.parametrize("number", [0, len(BASES) + 1])
def test_a_tpdo_without_an_identifier_is_refused(number):
    with pytest.raises(
        ValueError, match=f"TPDO {number} has no identifier, only TPDO 1 to {len(BASES)} have one: map its values"
    ):
        cob_id(number, 64)


def faults(changed):
    """Faults of the shipped machine file's bus with another publication: (key, problem)."""
    service = load(EXCAVATOR).service
    findings = Inspection()
    nodes(MachineFile.model_construct(nodes=()), Path(), changed(service.publication), findings)
    return [(fault.key, str(fault)) for fault in findings.errors]


def test_our_pdo_with_the_identifier_of_our_sdo_server_is_a_fault_of_node_id():
    for can_id in (0x640, 0x5C0, 0x740):
        ((key, problem),) = faults(lambda pdos, other=can_id: (*pdos[:-1], pdos[-1]._replace(can_id=other)))
        assert key == ("publication", "node_id")
        assert problem.startswith(f"is 64, which gives TPDO 8 of cylforce the COB-ID {can_id:03X}h: CiA 301 reserves")


def test_two_of_our_pdos_with_one_identifier_are_a_fault_of_node_id():
    ((key, problem),) = faults(lambda pdos: (*pdos[:-1], pdos[-1]._replace(can_id=pdos[1].can_id)))
    assert key == ("publication", "node_id")
    assert "TPDO 8 of cylforce the COB-ID 2C0h of its TPDO 2" in problem


def test_the_shipped_publication_has_no_fault():
    assert faults(lambda pdos: pdos) == []
