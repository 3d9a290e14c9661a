"""What a prior is told in a gust, and that there must be one."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.release.wrong_speeds import GUST, RAMP, feedback_of, gusty, steady
from contract.errors import ModelError
from contract.shipped import MODEL
from train import model_store


def test_a_gust_is_not_told_and_a_model_without_a_prior_is_refused():
    """The told speed is the speed over the ground, which a ramp leads to."""
    course, ground = gusty(0.8), steady(0.8, 1.0)
    assert course.told * course.speeds[:-1] == pytest.approx(ground.speeds[:-1])
    assert np.ptp(course.speeds[RAMP:]) == pytest.approx(2 * GUST, rel=1e-3)
    with pytest.raises(ModelError, match="no prior"):
        feedback_of(replace(model_store.load(MODEL), prior=None))
