"""Vendors' EDS files: each is read, or refused with a sentence."""

import shutil

import pytest

from cylforce.canopen.dictionary.vendor_eds import EdsError, default_mapping, mapped_code, profile, read
from cylforce.settings.machine_file import SettingsError, load

# The number of the device profile; 0 where the file leaves the device type open. CiA 301's sample is no device: its
# values carry inline comments, and it has no [DeviceInfo].
FILES = {
    "epson__M-A552AC1": 404,
    "epson__M-G550PC2": 404,
    "epson__M-G552PC10_Sample_6dof": 404,
    "epson__M-G552PC10_Sample_atti": 404,
    "epson__M-G552PC70_Sample_6dof": 404,
    "kacanopen__CiA_profiles_301": None,
    "kacanopen__CiA_profiles_401": 0,
    "kacanopen__CiA_profiles_402": 0,
    "kacanopen__CiA_profiles_406": 0,
    "kacanopen__Faulhaber_605.3150.55-D-EK-2-60": 402,
    "kacanopen__Faulhaber_605.3150.67-B-EK-2-60": 402,
    "kacanopen__Faulhaber_605.3150.73-A-EK-2-60": 402,
    "kacanopen__MaxonMotor_epos2_347717": 0,
    "kacanopen__SysTecElectronic_SO-1057_3301002_1": 401,
    "kacanopen__SysTecElectronic_SO-1057_MM217_V3Y_1": 401,
    "kacanopen__SysTecElectronic_SO-1057_MM217_Y_1": 401,
}


@pytest.fixture
def folder(shared):
    return shared / "data" / "eds"


def test_no_file_is_forgotten(folder):
    assert {path.stem for path in folder.glob("*.eds")} == set(FILES)


@pytest.mark.parametrize(("name", "number"), FILES.items())
def test_every_file_is_read_or_refused(folder, name, number):
    path = folder / f"{name}.eds"
    if number is None:
        with pytest.raises(EdsError) as refused:
            read(path)
        assert str(refused.value) == (
            f"{path.name} has no section [DeviceInfo], so it describes no device: ask its vendor for the EDS"
        )
        return
    eds = read(path)
    # every object of the file is there, sub-indices included
    sections = {line.strip()[1:-1].lower() for line in path.read_text("latin-1").splitlines() if line.startswith("[")}
    for section in sections:
        index, _, sub = section.partition("sub")
        if len(index) == 4 and all(c in "0123456789abcdef" for c in index + sub):
            assert eds.dictionary.get_variable(int(index, 16), int(sub or "0", 16)) or int(index, 16) in eds.dictionary
    assert profile(eds) == number


@pytest.mark.parametrize("name", [name for name in FILES if name.startswith("epson")])
def test_default_mapping_of_a_measuring_device(folder, name):
    """Status word and process values: whatever is mapped may be mapped, and its type is as wide as the mapping says."""
    eds = read(folder / f"{name}.eds")
    wide = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32, "f": 32}
    for number in (1, 2, 3, 4):
        mapped = default_mapping(eds, number)
        assert mapped
        assert [wide[mapped_code(eds, index, sub)] for index, sub, _ in mapped] == [bits for *_, bits in mapped]


GOOD = """\
[DeviceInfo]
VendorName=Somebody
VendorNumber=001
ProductNumber=
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x00020194
[7130]
ParameterName=Process value
ObjectType=0x8
SubNumber=4
[7130sub0]
ParameterName=Count
DataType=0x0005
AccessType=ro
[7130sub1]
ParameterName=Channel 1
DataType=0x0003 # INTEGER16
AccessType=ro
PDOMapping=1
[7130sub2]
ParameterName=Channel 2
DataType=0x0003
PDOMapping=0x01
[7130sub3]
ParameterName=Hidden
DataType=0x0003
AccessType=ro
PDOMapping=0
[2000]
ParameterName=Long
DataType=0x0015
AccessType=ro
PDOMapping=1
[1A00]
ParameterName=TPDO 1 mapping
ObjectType=0x9
SubNumber=3
[1A00sub0]
ParameterName=Count
DataType=0x0005
AccessType=const
DefaultValue=2
[1A00sub1]
ParameterName=First
DataType=0x0007
AccessType=const
DefaultValue=0x71300110
[1A00sub2]
ParameterName=Second
DataType=0x0007
AccessType=const
DefaultValue=0x71300210
"""


@pytest.fixture
def vendor(tmp_path):
    def write(text=GOOD, encoding="utf-8"):
        path = tmp_path / "sensor.eds"
        path.write_bytes(text.encode(encoding))
        return path

    return write


def test_usual_slips_are_mended(vendor):
    """Numbers with leading zeros or missing, an inline comment, a missing AccessType, Latin-1 and Windows text."""
    eds = read(vendor(GOOD.replace("Somebody", "Schönaich").replace("\n", "\r\n"), "latin-1"))
    assert eds.dictionary.device_information.vendor_number == 1
    assert eds.dictionary.device_information.product_number == 0
    assert profile(eds) == 404
    assert [mapped_code(eds, 0x7130, sub) for sub in (1, 2)] == ["h", "h"]
    assert default_mapping(eds, 1) == ((0x7130, 1, 16), (0x7130, 2, 16))
    assert default_mapping(eds, 2) == ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no section [DeviceInfo]"),
        ("ParameterName=x", "is no EDS file"),
        ("\0\xff\xfe", "is no EDS file"),
        (GOOD + "[7130]\nParameterName=again\n", "is no EDS file"),
        (GOOD.replace("DataType=0x0003\n", "DataType=none\n"), "cannot be interpreted"),
        (GOOD.replace("ParameterName=Hidden\n", ""), "cannot be interpreted"),
        (GOOD.replace("[7130]", "[7131]"), "cannot be interpreted"),
        (GOOD.replace("[1000]", "[100X]"), "lacks object 1000h"),
    ],
)
def test_the_rest_is_refused_with_one_sentence(vendor, text, said):
    with pytest.raises(EdsError, match=r"sensor\.eds") as refused:
        read(vendor(text))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_absent_file(tmp_path):
    with pytest.raises(EdsError, match="cannot be read"):
        read(tmp_path / "none.eds")


@pytest.mark.parametrize(
    ("index", "sub", "said"), [(0x7130, 9, "no object"), (0x7130, 3, "be mapped"), (0x2000, 0, "data type 0015h")]
)
def test_objects_that_no_sensor_may_have(vendor, index, sub, said):
    with pytest.raises(EdsError, match=said):
        mapped_code(read(vendor()), index, sub)


@pytest.fixture
def machine_with_eds(vendor, tmp_path, pytestconfig):
    """The shipped machine, its boom's pressures described by the vendor's EDS."""
    vendor()
    text = (pytestconfig.rootpath / "config" / "excavator_20t.toml").read_text()

    def write(*edits):
        edited = text.replace("identity = { serial = 1033 }", 'eds = "sensor.eds"').replace('type = "i16"\n', "", 2)
        for old, new in edits:
            assert old in edited
            edited = edited.replace(old, new, 1)
        path = tmp_path / "machine.toml"
        path.write_text(edited)
        return path

    return write


def test_types_come_from_the_eds(machine_with_eds):
    node = load(machine_with_eds()).service.nodes[0]
    assert node.profile == 404
    assert [field.code for field in node.pdos[0].fields] == ["h", "h"]


EDS_NODE = 'eds = "sensor.eds"'


@pytest.mark.parametrize(
    ("edits", "said"),
    [
        ([(EDS_NODE, 'eds = "none.eds"')], "nodes.boom_pressure.eds cannot be used"),
        ([("profile = 404", "profile = 410")], "nodes.boom_pressure.profile is 410, its EDS says 404"),
        ([('"7130h:2"', '"7130h:3"')], "sensors.boom_rod_pressure.object does not agree with its node's EDS"),
        (
            [('"7130h:2"', '"7130h:2"\ntype = "i32"')],
            "sensors.boom_rod_pressure.type is i32, its node's EDS says INTEGER16",
        ),
        (
            [
                (EDS_NODE, EDS_NODE + "\nwritable_mapping = false"),
                ('"7130h:1"', '"7130h:9"'),
                ('"7130h:9"', '"7130h:1"'),
                ('"7130h:1"', '"7130h:5"'),
            ],
            "sensors.boom_head_pressure.object does not agree",
        ),
    ],
)
def test_disagreement_with_the_eds_is_refused(machine_with_eds, edits, said):
    with pytest.raises(SettingsError) as refused:
        load(machine_with_eds(*edits))
    assert said in str(refused.value)


def test_a_fixed_mapping_must_be_described_in_its_order(machine_with_eds, vendor):
    fixed = [(EDS_NODE, EDS_NODE + "\nwritable_mapping = false")]
    assert not load(machine_with_eds(*fixed)).service.nodes[0].writable_mapping
    swapped = [*fixed, ('"7130h:1"', '"7130h:X"'), ('"7130h:2"', '"7130h:1"'), ('"7130h:X"', '"7130h:2"')]
    with pytest.raises(SettingsError, match=r"maps 7130h:1, 7130h:2 into TPDO 1 and cannot be changed"):
        load(machine_with_eds(*swapped))


def test_real_device_as_sensor(folder, machine_with_eds, tmp_path):
    """A vendor's own file behind a sensor; its PDO begins with a counter and ends with a value that nobody reads."""
    shutil.copy(folder / "epson__M-G550PC2.eds", tmp_path)
    edits = [
        (EDS_NODE, 'eds = "epson__M-G550PC2.eds"\nwritable_mapping = false'),
        ('"7130h:1"', '"7130h:1"\nskip_before = [{ object = "2100h" }]'),
        ('"7130h:2"', '"7130h:2"\nskip_after = [{ object = "7130h:3" }]'),
    ]
    (pdo,) = load(machine_with_eds(*edits)).service.nodes[0].pdos
    assert pdo.length == 8
    assert [(field.signal, field.code) for field in pdo.fields] == [
        (None, "H"),
        ("boom_head_pressure", "h"),
        ("boom_rod_pressure", "h"),
        (None, "h"),
    ]
    with pytest.raises(
        SettingsError, match=r"maps 2100h:0, 7130h:1, 7130h:2, 7130h:3 into TPDO 1 and cannot be changed"
    ):
        load(machine_with_eds(*edits[:2]))
