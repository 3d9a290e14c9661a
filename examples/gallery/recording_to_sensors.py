r"""
From a recording to sensors
===========================

For flow-control engineers who have a recording of wall pressures and must choose a few sensors for a controller. At the
end you have ranked the truck's 90 sensors in two ways and seen the positions of the best sensors. You know which calls
to change to rank your own sensors.

This page uses the shipped model and few windows, so that it is built in half a minute. The last section explains the
full procedure.
"""

# sphinx_gallery_thumbnail_number = 2

# %%
# The recording
# -------------
# The shipped recording has 72,500 control steps under open-loop forcing, and further steps under a controller. A step
# has the pressure coefficient Cp at 90 places, the action of the jets, and drag and lift. ``stillwake dataset inspect``
# lists its episodes. Three episodes are enough here. Time is in t_c = W / U_inf; the samples are 0.2 t_c apart.

import matplotlib.pyplot as plt
from rich import print

from contract.recording.dataset import read
from contract.shipped import recording

dataset = read(recording())
episodes = [episode for episode in dataset.episodes if episode.name in ("training_1", "training_2", "none_0")]
layout = dataset.layout
print({episode.name: len(episode) for episode in episodes})

# %%
# One minute of a truck's wake is about 600 t_c; the plot shows 60 t_c. The frequency of the jets varies, and the
# pressure on the base and the drag respond. A sensor near the front measures the same wake with a much smaller
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
# A model ranks the sensors. Its encoder computes eight latents from a window of all pressures and of the action. Its
# dynamics predict the next latents, and its decoder computes drag and lift from them. This page uses the shipped model.
# ``stillwake train`` makes such a model in half an hour. The data are the episodes and their mirror images, because the
# truck is symmetric.

from contract.shipped import model
from train.model_store import load
from train.networks.samples import prepare

trained = load(model())
rows = prepare(episodes, trained.scaling, mirrored=True, layout=layout)
accuracy = trained.metrics.teacher
print(f"in the held-out episode: R2 of drag {accuracy.drag.r2:.3f}, of lift {accuracy.lift.r2:.3f}")

# %%
# Ranked by SHAP
# --------------
# The paper ranks sensors by their contribution to the latents: the mean absolute SHAP value over random windows. The
# ranking is repeated with other random windows, to show how much it depends on them.

from contract.config.learning import TrainConfig
from train.selection.shap_ranking import rank

draws = TrainConfig(shap_background=50, shap_explained=25, shap_samples=4, shap_repeats=3)
ranking = rank(trained.teacher.encoder, rows, draws)
by_shap = ranking.top(4)
print(f"best four by SHAP: {', '.join(by_shap)}")
print(f"the same four in each of {len(ranking.scores)} draws: {ranking.is_stable(4)}")

# %%
# Chosen by QR pivoting
# ---------------------
# The second way needs no model: it chooses the four pressures that best reconstruct the pressures at all 90 places.
# They are the pivots of a QR decomposition of the leading POD modes.

from train.selection.methods import select_qr

by_qr = tuple(layout.names[column] for column in select_qr(rows, 4))
print(f"four by QR pivoting: {', '.join(by_qr)}")

# %%
# Where they are on the truck
# ---------------------------
# The flow comes from the left; the jets are at the two edges of the base. The colour shows each sensor's SHAP score;
# the rings mark the chosen sensors. A third method, forward selection under noise, chose the shipped release's four
# sensors.

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
# A controller reads only the chosen sensors, so a choice is judged by how well they determine the latents. A ridge
# regression replaces a trained encoder. The error is the share of the latents' variance that the regression does
# not explain. The sensors have noise of 5 % of the pressures' deviation, as in the release's training. Without noise a
# sensor near the front, where the signal is small, would be as good as a sensor on the base.

from train.selection.methods import RidgeStudent, select_greedy

student = RidgeStudent(trained.teacher.encoder, rows, seed=0, sensor_noise=0.05)
by_greedy = tuple(layout.names[column] for column in select_greedy(student, 4))
choices = {"SHAP": by_shap, "QR pivoting": by_qr, "greedy, under noise": by_greedy, "the release": trained.sensors}
for name, chosen in choices.items():
    missed = student.error(layout.indices(chosen).tolist())
    print(f"{name:20s} misses {100 * missed:4.1f} %: {', '.join(chosen)}")

# %%
# Greedy selection has the smallest error because it minimises exactly this error. The release's four sensors were
# chosen in the same way from other episodes. Only the closed loop shows which choice is best for a controller.
#
# The full procedure
# ------------------
# ``stillwake train runs/model`` does more than this page:
#
# - It trains the model on all training episodes.
# - With ``--set train.selection=shap`` it draws 100 background and 500 explained windows ten times. Even then only the
#   best two sensors are equal each time, and training with another seed ranks other sensors first: neighbours have the
#   same signal, and the model's weights decide by chance which neighbour gets a high SHAP value.
# - A slim encoder is trained on the four sensors, tested on other data, exported, and run in the closed loop. In the
#   closed loop the methods differ less than in any table of errors.
#
# The page :doc:`Studies </explanation/studies>` has these figures, and :doc:`Use your own data
# </how-to/use-your-own-data>` leads from your files to ``dataset`` above. To rank your own sensors, replace
# ``recording()`` by the path of your data set, and ``model()`` by the path of your model.
