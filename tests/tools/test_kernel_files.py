"""The study of the kernel's files covers the kernel: every function that the service calls is in one row."""

from cylforce.estimation.kernel import choice
from studies.kernel_files import FILES


def test_every_function_of_the_kernel_belongs_to_one_file():
    functions = {n for n in vars(choice.INTERPRETED) if not n.startswith("Kernel")} - {"state_size", "rows_size"}
    listed = [name for names in FILES.values() for name in names]
    assert sorted(listed) == sorted(functions)
