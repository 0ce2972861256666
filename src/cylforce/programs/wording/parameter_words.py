"""The parameters of the model in words: what each is, and which motion determines it. Pure."""

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
    "directional": (
        "friction larger one way than the other",
        "move the {0} cylinder slowly, both ways, in the same postures",
    ),
    "rocker": ("weight of the rocker and its link", "move the {0} cylinder through its range, slowly, both ways"),
    "stribeck": ("extra friction at creep", "move the {0} cylinder at creep, both ways"),
}
UNKNOWN = ("parameter of the model", "move every joint both ways, slowly and fast, through its whole range")


def meaning(name: str) -> str:
    """Return what a parameter is, in words."""
    return MEANING.get(name.rpartition(".")[2], UNKNOWN)[0]


def parameter(name: str) -> str:
    """Return a parameter with its place: `boom.coulomb` is the dry friction of the boom."""
    return f"{meaning(name)} of the {name.rpartition('.')[0]}"
