"""Identifiers (COB-IDs) of CANopen, from CiA 301: of one kind of message, most of them a base plus the node id."""

NMT, SYNC = 0x000, 0x080
# Bases, to which the node id (1 to 127) is added
EMCY = 0x080
TPDOS = 0x180, 0x280, 0x380, 0x480  # TPDO 1 to 4
RPDOS = 0x200, 0x300, 0x400, 0x500  # RPDO 1 to 4
SDO_RESPONSE, SDO_REQUEST = 0x580, 0x600  # from and to a node's SDO server
HEARTBEAT = 0x700
# Identifiers that a PDO may have: CiA 301 restricts all others to NMT, SYNC, EMCY, SDO and heartbeats
FIRST_PDO, LAST_PDO = 0x181, 0x57F
FIRST_OTHER_PDO, LAST_OTHER_PDO = 0x680, 0x6DF


def is_of_a_pdo(can_id: int) -> bool:
    """Return whether a PDO may have this identifier."""
    return FIRST_PDO <= can_id <= LAST_PDO or FIRST_OTHER_PDO <= can_id <= LAST_OTHER_PDO
