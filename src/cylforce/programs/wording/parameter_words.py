"""Parameters of the model in words: their meaning, and the motion that determines each. Pure."""

from cylforce.programs.wording.fault_words import number

# What a parameter is, and which motion determines it, by the end of its name.
MEANING = {
    "J": ("inertia about its pin", "start and stop {0} briskly, both ways"),
    "X": ("first moment along the link", "move {0} through more of its range, slowly, both ways"),
    "Z": ("first moment across the link", "move {0} through more of its range, slowly, both ways"),
    "D_excess": ("centrifugal term", "swing the house at working speed, with the arm out and in"),
    "E": ("centrifugal term", "swing the house at working speed, with the arm out and in"),
    "coulomb": ("dry friction", "move the {0} cylinder slowly, both ways"),
    "viscous": ("friction with speed", "move the {0} cylinder both slowly and fast"),
    "load_dependent": ("friction with load", "move the {0} cylinder with the arm out and in"),
    "cylinder": ("weight of the cylinder", "move the {0} cylinder through its range, slowly, both ways"),
    "delay": ("delay of the angle", "start and stop {0} briskly, both ways"),
    "directional": (
        "difference of the friction between its directions",
        "move the {0} cylinder slowly, both ways, in the same postures",
    ),
    "rocker": ("weight of the rocker and its link", "move the {0} cylinder through its range, slowly, both ways"),
    "stribeck": ("extra friction at creep", "move the {0} cylinder at creep, both ways"),
}
UNKNOWN = ("parameter of the model", "move every joint both ways, slowly and fast, through its whole range")


def meaning(name: str) -> str:
    """Return the meaning of a parameter in words."""
    return MEANING.get(name.rpartition(".")[2], UNKNOWN)[0]


def parameter(name: str) -> str:
    """Return a parameter with its location: `boom.coulomb` is the dry friction of the boom."""
    return f"{meaning(name)} of the {name.rpartition('.')[0]}"


# Words for a parameter of a link that is too large and too small.
WEIGHT = {"X": ("too heavy", "too light"), "J": ("too inert", "too little inert")}
SMALLEST_BASE = 0.05  # of the larger value: below, a change in per cent has no meaning


def parameter_error(name: str, unit: str, model: float, machine: float) -> str:
    """Return in words by how much a parameter of the model is wrong.

    model, machine: its value in the model, and as fitted to the machine
    """
    place, _, law = name.rpartition(".")
    larger = max(abs(model), abs(machine), 1e-300)
    if law in WEIGHT and min(abs(model), abs(machine)) > SMALLEST_BASE * larger and model * machine > 0.0:
        share = 100.0 * (model - machine) / machine
        return f"the {place} is {abs(share):.0f} % {WEIGHT[law][share < 0.0]}"
    word = "large" if model > machine else "small"
    return f"the {meaning(name)} of the {place} is {number(abs(model - machine))} {unit} too {word}"
