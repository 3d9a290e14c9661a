r"""
From a recording to sensors
===========================

For flow-control engineers who have a recording of wall pressures and ask which few sensors a controller should read.
At its end you have ranked the truck's 90 sensors in two ways, seen where on the body the best ones are, and know which
call to replace in order to rank your own.

The model is the shipped one, and few windows are drawn, so that this page is made in half a minute. The last section
explains what the full procedure does beyond it.
"""

# sphinx_gallery_thumbnail_number = 2

# %%
# The recording
# -------------
# The shipped recording holds 72,500 control steps under open-loop forcing, and more under a controller: the pressure
# coefficient Cp at 90 places, the action of the jets, and drag and lift. ``stillwake dataset inspect`` lists its
# episodes. Three of them are enough here. Time is in t_c = W / U_inf, and there is a sample every 0.2 t_c.

import matplotlib.pyplot as plt
from rich import print

from contract.recording.dataset import read
from contract.shipped import recording

dataset = read(recording())
episodes = [episode for episode in dataset.episodes if episode.name in ("training_1", "training_2", "none_0")]
layout = dataset.layout
print({episode.name: len(episode) for episode in episodes})

# %%
# One minute of a truck's wake is about 600 t_c; here are 60 of them. The jets sweep through frequencies, the pressure
# on the base answers, and drag follows. A sensor near the front feels the same wake, with a small part of the
# amplitude.

shown = slice(500, 800)
series = episodes[0].series
front, rear = (layout.names.index(name) for name in ("upper_05", "upper_39"))
base = layout.names.index("base_7")
figure, axes = plt.subplots(3, 1, sharex=True, figsize=(8, 5.5), layout="constrained")
axes[0].plot(series["t"][shown], series["action"][shown], color="tab:orange")
for column in (base, rear, front):
    axes[1].plot(series["t"][shown], series["Cp"][shown, column], label=layout.names[column])
axes[2].plot(series["t"][shown], series["Cd"][shown], color="black")
for axis, label in zip(axes, (r"action / $U_\infty W$", "$C_p$", "wall $C_d$"), strict=True):
    axis.set_ylabel(label)
    axis.grid(alpha=0.3)
axes[1].legend(ncols=3, loc="upper right", fontsize=8)
axes[2].set_xlabel(r"$t\,U_\infty / W$")
plt.show()

# %%
# The model
# ---------
# Sensors are ranked by what a model makes of them. Its encoder reads a window of all pressures and of the action into
# eight latents; dynamics take the latents a step further, and a decoder reads drag and lift from them. Here it is the
# shipped one. ``stillwake train`` makes such a model in half an hour. Episode and mirror image both count, because
# the truck is symmetric.

from contract.shipped import model
from train.model_store import load
from train.samples.rows import prepare

trained = load(model())
rows = prepare(episodes, trained.scaling, mirrored=True, layout=layout)
accuracy = trained.metrics.teacher
print(f"in the held-out episode: R2 of drag {accuracy.drag.r2:.3f}, of lift {accuracy.lift.r2:.3f}")

# %%
# Ranked by SHAP
# --------------
# The paper's way: how much each sensor contributes to the latents, by the mean absolute SHAP value over windows that
# are drawn at random. Drawing several times shows how firm the ranking is.

from train.selection.shap_ranking import ShapRanker, rank

ranker = ShapRanker(background=50, explained=25, samples=4)
ranking = rank(ranker, trained.teacher.encoder, rows, repeats=3, seed=0)
by_shap = ranking.top(4)
print(f"best four by SHAP: {', '.join(by_shap)}")
print(f"the same four in each of {len(ranking.scores)} draws: {ranking.is_stable(4)}")

# %%
# Chosen by QR pivoting
# ---------------------
# Another question, which needs no model: from which four pressures can the pressures at all 90 places be rebuilt
# best? The pivots of a QR decomposition of the leading POD modes answer it.

from train.selection.methods import select_qr

by_qr = tuple(layout.names[column] for column in select_qr(rows, 4))
print(f"four by QR pivoting: {', '.join(by_qr)}")

# %%
# Where they are on the truck
# ---------------------------
# The flow comes from the left; the jets are at the two edges of the base. Colour is the SHAP score of every sensor,
# rings are the choices. The shipped release has four sensors that a third method chose, forward selection under
# noise.

from contract.config.body import TRUCK_BODY
from wake.pictures.drawing import outline

figure, axis = plt.subplots(figsize=(8, 3.2), layout="constrained")
axis.fill(*outline(TRUCK_BODY).T, facecolor="0.88", edgecolor="0.3")
dots = axis.scatter(layout.positions[:, 0], layout.positions[:, 1], c=ranking.mean, s=28, cmap="viridis", zorder=3)
for chosen, colour, size, label in (
    (by_shap, "tab:red", 110, "SHAP"),
    (by_qr, "tab:blue", 190, "QR pivoting"),
    (trained.sensors, "black", 280, "the release"),
):
    places = layout.positions[layout.indices(chosen)]
    axis.scatter(
        places[:, 0], places[:, 1], s=size, facecolors="none", edgecolors=colour, linewidths=1.6, label=label, zorder=4
    )
axis.set(aspect="equal", xlabel="x / W", ylabel="y / W", xlim=(-0.3, 8.2), ylim=(-0.9, 0.9))
axis.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
figure.colorbar(dots, label="mean |SHAP|", fraction=0.02, aspect=12)
plt.show()

# %%
# What each choice is worth
# -------------------------
# A controller sees the chosen sensors alone, so each choice is judged by how well the latents can be read from it. A
# ridge regression stands in for the encoder that would be trained; its error is the share of the latents' variance
# that it misses. The sensors have noise of 5 % of the pressures' deviation, as in the release's training: without
# noise a sensor near the front, which barely moves, would be as good as one on the base.

from train.selection.methods import select_greedy
from train.selection.ridge_student import ridge_student

student = ridge_student(trained.teacher.encoder, rows, seed=0, sensor_noise=0.05)
by_greedy = tuple(layout.names[column] for column in select_greedy(student, 4))
choices = {"SHAP": by_shap, "QR pivoting": by_qr, "greedy, under noise": by_greedy, "the release": trained.sensors}
for name, chosen in choices.items():
    missed = student.error(layout.indices(chosen).tolist())
    print(f"{name:20s} misses {100 * missed:4.1f} %: {', '.join(chosen)}")

# %%
# Greedy selection has the smallest error because it was made to: it chose by this very student, which is also how the
# release's four were found, from other episodes. Whether a choice is the best one for a controller is another matter,
# and only the closed loop shows it.
#
# The full procedure
# ------------------
# ``stillwake train runs/model`` does more than this page:
#
# - It trains the model, from all training episodes.
# - Where SHAP chooses (``--set train.selection=shap``), it takes 100 background and 500 explained windows, ten times
#   over. Even so, only the best two are the same in all draws, and another seed of the training ranks other sensors
#   first: neighbours carry the same signal, and SHAP divides the credit as the weights happen to.
# - A slim encoder is trained on the chosen four, judged on held-out data, exported, and run in the closed loop. There
#   the methods lie closer together than in any table of errors.
#
# The page :doc:`Studies </explanation/studies>` has those figures, and :doc:`Use your own data
# </how-to/use-your-own-data>` leads from your files to ``dataset`` above. To rank your own sensors, take the path of
# your data set in place of ``recording()``, and that of your model in place of ``model()``.
