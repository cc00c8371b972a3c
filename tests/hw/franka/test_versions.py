from __future__ import annotations

import numpy as np
import pytest

from hw.errors import DeviceUnavailable
from hw.franka.versions import MATRIX, PACKAGES, Package, explain_mismatch, installed, load


def test_a_missing_driver_says_how_to_install_it() -> None:
    absent = Package("no-such-franka-driver", "1.0", "no_such_franka_driver", "0.0", 0)
    with pytest.raises(DeviceUnavailable, match=r"not installed; run: pip install no-such-franka-driver==1\.0"):
        installed(absent)


def test_another_version_of_the_driver_is_named() -> None:
    other = Package("numpy", "0.0.1", "numpy", "0.9.2", 5)
    with pytest.raises(DeviceUnavailable, match=rf"numpy {np.__version__} is installed, but 0\.0\.1"):
        load(other)


def test_a_driver_that_does_not_import_is_a_message() -> None:
    broken = Package("numpy", np.__version__, "numpy.no_such_module", "0.9.2", 5)
    with pytest.raises(DeviceUnavailable, match=r"does not import .*--force-reinstall"):
        load(broken)


@pytest.mark.parametrize("model", PACKAGES)
def test_the_tested_drivers_are_what_the_matrix_asks_for(model: str) -> None:
    package = PACKAGES[model]
    (row,) = (row for row in MATRIX if row.interface == package.interface)
    assert row.remedy == package.install
    assert installed(package) == package.version
    assert load(package).Robot


def test_other_words_are_no_mismatch() -> None:
    assert explain_mismatch("fr3", "libfranka: UDP receive: Timeout") is None


def test_an_arm_newer_than_the_matrix_says_so() -> None:
    words = explain_mismatch("fr3", "Incompatible library version (server version: 12, library version: 10)")
    assert words is not None
    assert "no row for it" in words
