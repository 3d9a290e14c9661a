"""Rows against the episodes they are made of, batches against brute force, and scaling against its mirror image."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from contract import sensors
from contract.errors import ConfigError, DatasetError
from contract.recording.dataset import Episode
from tests.train.conftest import LAYOUT
from train.networks.samples import Rows, SegmentSampler, add_sensor_noise, fit_scaling, prepare


def test_rows_are_standardised_with_the_action_before_them(rows):
    for values in (rows.inputs[:, : sensors.COUNT], rows.actions[:, None], rows.forces):
        torch.testing.assert_close(values.mean(dim=0), torch.zeros(values.shape[1]), rtol=0, atol=1e-5)
        torch.testing.assert_close(values.std(dim=0, correction=0), torch.ones(values.shape[1]), rtol=1e-5, atol=0)
    # Chosen sensors keep their order and the action.
    slim = rows.with_sensors(sensors.TRUCK.indices(["base_9", "upper_02"]))
    assert torch.equal(slim.inputs, rows.inputs[:, [89, 2, 90]])


def test_a_row_holds_the_pressures_and_the_action_before_them(small_recording):
    episode = replace(small_recording.episodes[0], initial_action=0.03)
    scaling = fit_scaling([episode])
    rows = prepare([episode], scaling, mirrored=False)
    for k in (0, 1, 13):
        before = 0.03 if k == 0 else episode.series["action"][k - 1]
        assert rows.inputs[k, -1].item() == pytest.approx(before / scaling.action_std, rel=1e-6)
        assert rows.actions[k].item() == pytest.approx(episode.series["action"][k] / scaling.action_std, rel=1e-6)
        physical = rows.inputs[k, 55].item() * scaling.pressure_std[55] + scaling.pressure_mean[55]
        assert physical == pytest.approx(episode.series["Cp"][k, 55], rel=1e-5)


WINDOW, AHEAD = 8, 5


def sampler(rows: Rows, segment: int, *, batch_size: int = 64, seed: int = 0) -> SegmentSampler:
    return SegmentSampler(rows, window=WINDOW, ahead=AHEAD, segment=segment, batch_size=batch_size, seed=seed)


def test_one_pass_holds_every_sample_and_none_across_a_boundary(rows):
    wanted = {
        end
        for span in rows.spans()
        for end in range(span.start, span.stop)
        if end - WINDOW + 1 >= span.start and end + AHEAD < span.stop
    }
    for segment in (1, 4, 7):
        drawn = sampler(rows, segment)
        assert drawn.samples == len(wanted)
        steps_in_pass = -(-len(wanted) // (64 // segment * segment))
        # Ragged ends overlap, so segments can need a few batches more than samples do.
        seen = {int(end) for step in range(steps_in_pass) for end in drawn.batch(step).ends[:, :segment].flatten()}
        assert seen <= wanted, segment
        assert len(seen) >= (1.0 if segment == 1 else 0.9) * len(wanted), segment


def test_a_batch_agrees_with_brute_force_and_depends_on_seed_and_step_alone(rows):
    drawn = sampler(rows, 3)
    batch = drawn.batch(5)
    for segment, first in enumerate(drawn.first_rows(5)):
        for w in range(3 + AHEAD):
            end = int(first) + WINDOW - 1 + w
            window = batch.inputs[segment, w : w + WINDOW]
            assert torch.equal(window, rows.inputs[end - WINDOW + 1 : end + 1])
            assert batch.ends[segment, w] == end
            assert batch.actions[segment, w] == rows.actions[end]
            assert torch.equal(batch.forces[segment, w], rows.forces[end])
    # Batches depend on seed and step alone.
    one, two = sampler(rows, 4, seed=3), sampler(rows, 4, seed=3)
    later = one.first_rows(40)
    for step in (0, 17):
        two.first_rows(step)
    np.testing.assert_array_equal(two.first_rows(40), later)
    assert not np.array_equal(sampler(rows, 4, seed=4).first_rows(40), later)
    assert not np.array_equal(one.first_rows(0), later)


def test_noise_is_one_pressure_everywhere_and_spares_the_action(small_recording):
    episodes = small_recording.with_role("train")
    scaling = fit_scaling(episodes)
    rows = prepare(episodes, scaling, mirrored=False)
    chosen = sensors.TRUCK.indices(["upper_00", "base_0"])
    few = rows.with_sensors(chosen)
    physical = few.noise(0.3).numpy() * np.array(scaling.pressure_std)[chosen]
    assert physical == pytest.approx(0.3 * np.sqrt(np.square(scaling.pressure_std).mean()), rel=1e-5)
    batch = SegmentSampler(few, window=12, ahead=0, segment=8, batch_size=256, seed=0).batch(0)
    torch.manual_seed(0)
    change = add_sensor_noise(batch, few.noise(0.3)).inputs - batch.inputs
    assert bool((change[..., -1] == 0).all())
    # some 600 draws a column: 3 % on a deviation
    assert change[..., :-1].flatten(0, 1).std(dim=0).numpy() == pytest.approx(few.noise(0.3).numpy(), rel=0.1)
    assert add_sensor_noise(batch, few.noise(0.0)) is batch


def with_series(episode: Episode, **series: np.ndarray) -> Episode:
    return replace(episode, series={**episode.series, **series})


def test_without_mirror_images_scaling_is_that_of_the_recording_alone(foreign_recording):
    episodes = foreign_recording.with_role("train")
    scaling = fit_scaling(episodes, LAYOUT)
    rows = prepare(episodes, scaling, mirrored=False, layout=LAYOUT)
    assert rows.inputs.shape == (870, 8)
    torch.testing.assert_close(rows.inputs[:, :7].mean(dim=0), torch.zeros(7), rtol=0, atol=1e-5)
    # An action is not shifted: none stays zero.
    assert rows.actions[-100:-20].abs().max() == 0.0
    with pytest.raises(ConfigError, match="no mirror images"):
        prepare(episodes, scaling, mirrored=True, layout=LAYOUT)


def test_scaling_commutes_with_mirroring(small_recording):
    scaling = fit_scaling(small_recording.with_role("train"))
    (episode,) = small_recording.with_role("test")
    reflected = replace(
        with_series(
            episode,
            action=-episode.series["action"],
            Cl=-episode.series["Cl"],
            Cp=episode.series["Cp"][:, np.array(sensors.TRUCK.mirror)],
        ),
        initial_action=-episode.initial_action,
    )
    both = prepare([episode], scaling, mirrored=True)
    direct = prepare([reflected], scaling, mirrored=False)
    half = len(episode)
    for name in ("inputs", "actions", "forces"):
        torch.testing.assert_close(getattr(both, name)[half:], getattr(direct, name), rtol=1e-5, atol=1e-5)
    assert scaling.force_mean[1] == 0.0
    mirror = np.array(sensors.TRUCK.mirror)
    np.testing.assert_array_equal(np.array(scaling.pressure_mean)[mirror], scaling.pressure_mean)


def test_a_signal_that_never_changes_is_refused(small_recording):
    for series, message in (("Cp", "sensor upper_03 is constant at 0.25"), ("Cl", "Cl is constant")):
        stuck = []
        for episode in small_recording.with_role("train"):
            values = episode.series[series].copy()
            values[(slice(None), 3) if series == "Cp" else slice(None)] = 0.25 if series == "Cp" else 0.0
            stuck.append(with_series(episode, **{series: values}))
        with pytest.raises(DatasetError, match=message):
            fit_scaling(stuck)
