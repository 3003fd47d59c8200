"""The peers of `bench learning`, run by the Python of an environment of their own: reads tasks from a file, writes
answers.

    python learning_peers.py TASKS.pickle ANSWERS.pickle

A task is ``(kind, demonstrations)``; a demonstration is ``(times, points)`` in s and m. Each peer is used as its
documentation shows.
"""

# pyright: basic, reportMissingImports=false, reportUnknownParameterType=false
import pickle
import sys
import time
from pathlib import Path

import numpy as np

POINTS = 300
WEIGHTS = (3, 4, 5, 6, 8, 10, 12, 15, 18, 21, 25, 30, 35, 40, 50, 60, 80)


def filtered(points):
    """The paper's filter: a moving average of seven samples."""
    padded = np.concatenate([np.repeat(points[:1], 3, axis=0), points, np.repeat(points[-1:], 3, axis=0)])
    return np.stack([padded[i : i + len(points)] for i in range(7)]).mean(axis=0)


def at_even_times(demonstrations):
    """Every demonstration at 300 even instants of its own time: shape (u, 300, d)."""
    grid = np.linspace(0.0, 1.0, POINTS)
    return np.stack(
        [np.column_stack([np.interp(grid, t / t[-1], axis) for axis in filtered(p).T]) for t, p in demonstrations]
    )


def naive(demonstrations, components=4):
    """fastdtw as pip installs it to the longest, scikit-learn's mixture over time, the gmr package step by step."""
    from fastdtw import fastdtw
    from gmr import GMM
    from scipy.spatial.distance import euclidean
    from sklearn.mixture import GaussianMixture

    smooth = [filtered(points) for _, points in demonstrations]
    longest = int(np.argmax([len(points) for points in smooth]))
    reference, times = smooth[longest], demonstrations[longest][0]
    rows = []
    for points in smooth:
        _, path = fastdtw(reference, points, radius=1, dist=euclidean)
        pairs = np.array(path)
        hits = np.bincount(pairs[:, 0], minlength=len(reference))
        warped = np.column_stack(
            [
                np.bincount(pairs[:, 0], weights=points[pairs[:, 1], axis], minlength=len(reference)) / hits
                for axis in range(points.shape[1])
            ]
        )
        rows.append(np.column_stack([times, warped]))
    samples = np.concatenate(rows)
    fitted = GaussianMixture(components, random_state=0).fit(samples)
    model = GMM(components, fitted.weights_, fitted.means_, fitted.covariances_, random_state=0)
    steps = np.linspace(times[0], times[-1], len(reference))
    return np.concatenate([model.condition([0], [step]).to_mvn().mean[None] for step in steps])


def promp(demonstrations, weights=30):
    """movement_primitives' ProMP on linear time."""
    return promp_of(at_even_times(demonstrations), weights)


def promps_of(curves):
    """movement_primitives' ProMP of curves (u, n, d) already aligned, by number of weights."""
    return {weights: promp_of(curves, weights) for weights in WEIGHTS}


def promp_of(curves, weights):
    """movement_primitives' ProMP of curves (u, n, d) already aligned."""
    from movement_primitives.promp import ProMP

    clock = np.linspace(0.0, 1.0, curves.shape[1])
    model = ProMP(n_dims=curves.shape[2], n_weights_per_dim=weights)
    model.imitate(np.repeat(clock[None], len(curves), axis=0), curves)
    return model.mean_trajectory(np.linspace(0.0, 1.0, POINTS))


def dmp(demonstrations, weights=30):
    """movement_primitives' DMP of the mean on linear time."""
    from movement_primitives.dmp import DMP

    mean = at_even_times(demonstrations).mean(axis=0)
    model = DMP(n_dims=mean.shape[1], execution_time=1.0, dt=1.0 / (POINTS - 1), n_weights_per_dim=weights)
    model.imitate(np.linspace(0.0, 1.0, POINTS), mean)
    model.configure(start_y=mean[0], goal_y=mean[-1])
    return model.open_loop()[1]


def barycentre(demonstrations):
    """tslearn's DTW barycentre averaging."""
    from tslearn.barycenters import dtw_barycenter_averaging

    return dtw_barycenter_averaging(at_even_times(demonstrations)[:, ::2], max_iter=30)


def elastic(demonstrations):
    """fdasrsf's elastic (square-root velocity) mean of open curves, laid where and as large as the people drew.

    The package gives a mean of unit length about the origin; size and place are the people's average ones.
    """
    import fdasrsf.curve_stats

    curves = at_even_times(demonstrations)[:, ::5]
    stats = fdasrsf.curve_stats.fdacurve(curves.transpose(2, 1, 0).copy(), mode="O", N=curves.shape[1], scale=False)
    stats.karcher_mean(rotation=False, parallel=False, cores=1)
    mean = stats.beta_mean.T - stats.beta_mean.T.mean(axis=0)
    radii = np.sqrt(((curves - curves.mean(axis=1, keepdims=True)) ** 2).sum(axis=(1, 2)))
    return mean * (radii.mean() / np.sqrt((mean**2).sum())) + curves.mean(axis=(0, 1))


def linear(demonstrations):
    """The plain mean on linear time."""
    return at_even_times(demonstrations).mean(axis=0)


def regression(model):
    """Processor seconds that gmr takes for mean and covariance at 1000 steps, one condition a step."""
    from gmr import GMM

    priors, means, covariances = model
    mixture = GMM(len(priors), priors, means, covariances, random_state=0)
    began = time.process_time()
    for step in np.linspace(0.0, 1.0, 1000):
        found = mixture.condition([0], [step]).to_mvn()
        _ = (found.mean, found.covariance)
    return time.process_time() - began


PEERS = {
    "naive": naive,
    "ProMP": promp,
    "DMP": dmp,
    "tslearn DBA": barycentre,
    "elastic mean": elastic,
    "linear mean": linear,
}
PEERS |= {"ProMPs aligned": promps_of, "gmr": regression}


def main() -> None:
    """Answer every task with (result, seconds), or with the words of what went wrong; processor seconds."""
    tasks, answers = Path(sys.argv[1]), Path(sys.argv[2])
    found = []
    for kind, given in pickle.loads(tasks.read_bytes()):
        began = time.process_time()
        try:
            found.append((PEERS[kind](given), time.process_time() - began))
        except Exception as error:
            found.append((f"{type(error).__name__}: {error}", time.process_time() - began))
    answers.write_bytes(pickle.dumps(found))


if __name__ == "__main__":
    main()
