"""Narrower dynamics and decoder for small ECUs, distilled from the trained ones on roll-outs (ours).

The paper slims the encoder alone. Nearly all work of a control step is in the other two networks, which the
optimiser rolls out `horizon` steps ahead, forth and back, in every iteration. So the student is trained as it will
serve: on whole roll-outs of that length, in which the small errors of single steps add up.

The teacher gives a roll-out for any actions, not only for recorded ones. Half the roll-outs take the actions recorded
after their start, half those recorded elsewhere: the optimiser tries plans that the recording did not hold.
"""

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from contract.config.tree import Config
from train.distil import encode_all
from train.evaluate import rollout_starts
from train.fit import Checkpoints, Schedule, optimise, seeded
from train.loss import prediction_loss
from train.model import Predictor, WakeModel
from train.progress import Phase, Progress, silent
from train.rows import Rows

_FEWER = 4
"""Times fewer roll-outs a batch than windows in training: each holds H predictions."""


def distil_predictor(
    teacher: WakeModel,
    rows: Rows,
    config: Config,
    *,
    progress: Progress = silent,
    checkpoints: Checkpoints | None = None,
) -> Predictor:
    """Train dynamics and decoder of the slim widths to roll out as the teacher's do.

    The loss is the mean square of the latents' difference over h = 1 .. H plus the forces' Smooth L1 over
    h = 0 .. H, H = `config.mpc.horizon`; both in standard deviations, so neither needs a weight.

    Args:
        rows: with all sensors' columns; starts are the teacher's latents there.

    Returns:
        The student in evaluation mode, on the device of `rows`.

    Raises:
        DatasetError: if no episode is long enough for a window and the horizon.
    """
    settings, horizon, device = config.train, config.mpc.horizon, rows.inputs.device
    batch_size = max(2, settings.batch_size // _FEWER)
    latents = encode_all(teacher.encoder, rows)
    starts = rollout_starts(rows, config.model.window, horizon)
    ahead = torch.arange(horizon, device=device)
    schedule = Schedule(
        steps=max(1, round(settings.predictor_epochs * len(starts) / batch_size)),
        learning_rate=settings.learning_rate,
        shape=settings.schedule,
    )
    with seeded(settings.seed, device):
        student = Predictor(config.model.slim)

        def loss(step: int) -> Mapping[str, Tensor]:
            generator = np.random.default_rng((settings.seed, step))
            drawn = torch.as_tensor(generator.integers(len(starts), size=(2, batch_size)), device=device)
            begin, elsewhere = starts[drawn]
            elsewhere[::2] = begin[::2]
            latent, actions = latents[begin], rows.actions[elsewhere[:, None] + ahead]
            with torch.no_grad():
                target = torch.cat([latent[None], teacher.dynamics.rollout(latent, actions)])
                forces = teacher.decoder(target)
            predicted = student.dynamics.rollout(latent, actions)
            latent_loss = prediction_loss(predicted, target[1:])
            decoded = student.decoder(torch.cat([latent[None], predicted]))
            force_loss = nn.functional.smooth_l1_loss(decoded, forces)
            return {"total": latent_loss + force_loss, "prediction": latent_loss, "force": force_loss}

        student.to(device)
        optimise(student, loss, schedule, phase=Phase.PREDICTOR, progress=progress, checkpoints=checkpoints)
    return student
