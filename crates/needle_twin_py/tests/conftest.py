from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def bag():
    """The shipped needle insertion (synthetic; bags/README.md)."""
    return ROOT / "bags" / "needle_insertion"


@pytest.fixture
def small():
    """A compression on a coarse half-plane cloud: a run takes a fraction of a second."""
    import needle_twin

    return needle_twin.Scene("compression", {"discretisation.spacing_m": 0.002, "motion.depth_m": 5e-4, "motion.pose_hz": 100})
