"""Before any test of the rig is read."""

from __future__ import annotations

import pytest

from tests.waiting import patient_calls as patient_calls

# It holds tests, but its name does not say so to pytest: its asserts would not show what they compared.
pytest.register_assert_rewrite("tests.rig.conformance")
