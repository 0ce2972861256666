"""Recordings that a diagnosis cannot use, or not as they are: an answer with its uncertainty, or a sentence that names
the file; never a confident name."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
