"""The latent model (paper, section 2.2 and table 1): encoder, dynamics, force decoder.

    z_t       = f_enc(S_t)              S_t: the last L rows, row k is (Cp_k, a_{k-1})
    z_{t+1}   = z_t + f_dyn(z_t, a_t)
    C_t       = f_dec(z_t)              C = (Cd, Cl)

All values are standardised (`train.networks.samples`). In shapes, B is the number of samples, L the window, F the
number of features in a row, N_z the latent dimension.

The joint loss (paper, equation 5) is

    L = L_pred + lambda_force L_force + lambda_var L_var + lambda_cov L_cov [+ lambda_decode L_decode, ours]

The dynamics are unrolled k steps from the encoded z_t to predict latents. The targets are the encoder's own latents at
t+1 .. t+k; gradients flow through targets and predictions, so the encoder learns a predictable state. The VICReg terms
act on the predictions and prevent a collapse of the latents.

The paper has no L_decode. This term is L_force before the first step, for the encoded latent. Without this term, an
unroll of 20 steps would train the decoder mostly on latents with the accumulated errors of many steps.
"""

import torch
from torch import Tensor, nn

from contract.config.learning import ModelConfig, TrainConfig
from train.networks.recurrence import last_hidden
from train.networks.samples import Batch


class Encoder(nn.Module):
    """An LSTM over the window, then LayerNorm and a two-layer ELU perceptron on the LSTM's final hidden state. The slim
    encoder is this network with fewer features. `torch.nn.LSTM` stores and initialises the LSTM's weights, but on a CPU
    `train.networks.recurrence` evaluates the LSTM, because overlapping windows can share computations."""

    def __init__(self, sensors: int, config: ModelConfig) -> None:
        super().__init__()
        self.window = config.window
        self.lstm = nn.LSTM(sensors + 1, config.lstm_width, batch_first=True)
        self.norm = nn.LayerNorm(config.lstm_width)
        self.hidden = nn.Linear(config.lstm_width, config.lstm_width)
        self.output = nn.Linear(config.lstm_width, config.latent)

    def forward(self, windows: Tensor) -> Tensor:
        """Encode windows (B, L, F) as latents (B, N_z)."""
        return self.encode_segments(windows)[:, 0]

    def encode_segments(self, segments: Tensor) -> Tensor:
        """Encode S segments of R rows (S, R, F) as latents (S, R - L + 1, N_z) at rows L-1 .. R-1 of each segment."""
        if segments.is_cuda:
            # On a GPU, cuDNN runs all steps of a window in one kernel, which is faster than sharing computations.
            unfolded = segments.unfold(1, self.window, 1).transpose(2, 3)
            states, _ = self.lstm(unfolded.flatten(0, 1))
            last = states[:, -1].unflatten(0, unfolded.shape[:2])
        else:
            last = last_hidden(segments, self.window, *self.lstm.all_weights[0])
        return self.read_out(last)

    def encode_stream(self, segments: Tensor) -> Tensor:
        """Encode like `encode_segments`, but do not reset the LSTM's state within a segment. Each row then takes one
        LSTM step instead of L. The latent at row k depends on all rows of its segment up to k."""
        hidden, _ = self.lstm(segments)
        return self.read_out(hidden[:, self.window - 1 :])

    def read_out(self, state: Tensor) -> Tensor:
        """Convert the LSTM's hidden states (..., H) to latents (..., N_z)."""
        latent: Tensor = self.output(nn.functional.elu(self.hidden(self.norm(state))))
        return latent


class Dynamics(nn.Module):
    """A residual perceptron in latent space that predicts one control period ahead: z + f(z, a)."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        width = config.dynamics_width
        self.input = nn.Linear(config.latent + 1, width)
        self.norm_in = nn.LayerNorm(width)
        self.hidden = nn.Linear(width, width)
        self.norm_hidden = nn.LayerNorm(width)
        self.output = nn.Linear(width, config.latent)

    def forward(self, latent: Tensor, action: Tensor) -> Tensor:
        """Predict latents (..., N_z) at t + 1 from latents (..., N_z) at t and actions (...,) commanded at t."""
        x = torch.cat([latent, action[..., None]], dim=-1)
        x = nn.functional.elu(self.norm_in(self.input(x)))
        x = nn.functional.elu(self.norm_hidden(self.hidden(x)))
        change: Tensor = self.output(x)
        return latent + change

    def rollout(self, latent: Tensor, actions: Tensor) -> Tensor:
        """Predict latents (h, ..., N_z) at t+1 .. t+h from latents (..., N_z) at t and actions (..., h) from t on."""
        states = []
        for action in actions.unbind(-1):
            latent = self(latent, action)
            states.append(latent)
        return torch.stack(states)


class ResidualBlock(nn.Module):
    """A layer x + Dropout(ELU(LayerNorm(Linear(x)))), for any shape (..., width)."""

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.linear = nn.Linear(width, width)
        self.norm = nn.LayerNorm(width)
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor) -> Tensor:
        change: Tensor = self.dropout(nn.functional.elu(self.norm(self.linear(x))))
        return x + change


class Decoder(nn.Module):
    """A residual perceptron from a latent to the forces."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.input = nn.Linear(config.latent, config.decoder_width)
        self.blocks = nn.ModuleList(
            ResidualBlock(config.decoder_width, config.dropout) for _ in range(config.decoder_blocks)
        )
        self.output = nn.Linear(config.decoder_width, 2)

    def forward(self, latent: Tensor) -> Tensor:
        """Compute the scaled forces (..., 2), Cd and Cl, from latents (..., N_z)."""
        x: Tensor = self.input(latent)
        for block in self.blocks:
            x = block(x)
        forces: Tensor = self.output(x)
        return forces


class Predictor(nn.Module):
    """The networks that the optimiser rolls out: dynamics and decoder."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        self.dynamics = Dynamics(config)
        self.decoder = Decoder(config)


class WakeModel(nn.Module):
    """The three networks that are trained together: encoder, dynamics and decoder."""

    def __init__(self, sensors: int, config: ModelConfig) -> None:
        super().__init__()
        self.encoder = Encoder(sensors, config)
        self.dynamics = Dynamics(config)
        self.decoder = Decoder(config)


EPSILON = 1e-4
"""Constant inside the square root of the variance term. VICReg's authors use 1e-4; the paper states only "small"."""


def joint_loss(model: WakeModel, batch: Batch, config: TrainConfig) -> dict[str, Tensor]:
    """Compute the loss of a batch. A segment of W windows has W - k samples, with k = `config.unroll` steps each.
    Returns scalars by name: the weighted sum "total", and the terms without weights."""
    steps = config.unroll
    encode = model.encoder.encode_stream if config.streamed else model.encoder.encode_segments
    encoded = encode(batch.inputs)
    samples = encoded.shape[1] - steps
    start = encoded[:, :samples].flatten(0, 1)
    actions = batch.actions.unfold(1, steps, 1)[:, :samples].flatten(0, 1)
    predicted = model.dynamics.rollout(start, actions)
    target = torch.stack([encoded[:, i : i + samples].flatten(0, 1) for i in range(1, steps + 1)])
    forces = torch.stack([batch.forces[:, i : i + samples].flatten(0, 1) for i in range(1, steps + 1)])
    prediction = prediction_loss(predicted, target)
    force = nn.functional.smooth_l1_loss(model.decoder(predicted), forces)
    decode = nn.functional.smooth_l1_loss(model.decoder(encoded), batch.forces)
    variance, covariance = variance_loss(predicted), covariance_loss(predicted)
    total = (
        prediction
        + config.force_weight * force
        + config.decode_weight * decode
        + config.variance_weight * variance
        + config.covariance_weight * covariance
    )
    losses = {"total": total, "prediction": prediction, "force": force, "decode": decode}
    return {**losses, "variance": variance, "covariance": covariance}


def prediction_loss(predicted: Tensor, target: Tensor) -> Tensor:
    """Compute the mean square error over samples, steps and dimensions of latents (..., N_z). The paper has the squared
    L2 norm, a sum over the N_z = 8 dimensions. In a test with an oscillator and a variance weight of 0.02, all latents
    became equal with this sum; with the mean, the same number of steps gave a fit with R2 = 0.99."""
    return (predicted - target).square().mean()


def variance_loss(latents: Tensor) -> Tensor:
    """Compute the mean of max(0, 1 - sqrt(Var + epsilon)) for latents (..., B, D), over dimensions and leading axes."""
    deviation = (latents.var(dim=-2) + EPSILON).sqrt()
    return nn.functional.relu(1.0 - deviation).mean()


def covariance_loss(latents: Tensor) -> Tensor:
    """Compute the mean square of the off-diagonal covariances of latents (..., B, D), also over leading axes."""
    count, dimension = latents.shape[-2:]
    if dimension == 1:
        return latents.new_zeros(())
    centred = latents - latents.mean(dim=-2, keepdim=True)
    covariance = centred.transpose(-1, -2) @ centred / (count - 1)
    squares = covariance.square()
    off_diagonal = squares.sum(dim=(-2, -1)) - squares.diagonal(dim1=-2, dim2=-1).sum(dim=-1)
    return (off_diagonal / (dimension * (dimension - 1))).mean()
