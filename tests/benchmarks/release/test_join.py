"""A model that cannot imitate or be imitated is refused before any flow is run; what a prior is told in a gust."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.release.join import RAMP, feedback_of, join
from benchmarks.release.wrong_speeds import GUST, gusty, steady
from contract.errors import ModelError
from contract.shipped import MODEL
from train import model_store


def test_models_that_cannot_be_joined_are_refused():
    model = model_store.load(MODEL)
    with pytest.raises(ModelError, match="speed is 1"):
        join(model, [(1.0, MODEL)])
    short = {**(model.prior or {}), "filters": np.zeros((8, 8))}
    others = (
        (replace(model, prior=None), "no prior"),
        (replace(model, sensors=("base_0",)), "base_0"),
        (replace(model, prior=short), "8 rows"),
    )
    for other, reason in others:
        with pytest.raises(ModelError, match=reason):
            feedback_of(other, model)


def test_a_gust_is_not_told():
    """The told speed is the speed over the ground, which a ramp leads to."""
    course, ground = gusty(0.8), steady(0.8, 1.0)
    assert course.told * course.speeds[:-1] == pytest.approx(ground.speeds[:-1])
    assert np.ptp(course.speeds[RAMP:]) == pytest.approx(2 * GUST, rel=1e-3)
