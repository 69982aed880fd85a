"""Writes metrics.json: two small depth maps and what independent implementations say of them.

Python 3.11, numpy==2.4.6, scipy==1.17.1, scikit-image==0.26.0, scikit-learn==1.9.1
Run: python metrics.py (in this folder)
"""

import json

import numpy as np
from scipy import integrate, ndimage, stats
from skimage.feature import canny
from sklearn import metrics as sk

H, W = 24, 32
rng = np.random.default_rng(20240611)
y, x = np.mgrid[0:H, 0:W]

truth = 3.0 + 0.03 * y + 0.01 * x
truth[6:18, 8:16] = 1.4 + 0.01 * y[6:18, 8:16]
truth[:, 24:26] = 0.9
truth[3:9, 18:22] = 5.5
prediction = ndimage.gaussian_filter(truth, 1.1) * (1 + 0.05 * np.sin(x / 5.0 + y / 7.0)) / 1.7
prediction += 0.02 * rng.standard_normal((H, W))
truth[rng.random((H, W)) < 0.03] = 0.0
truth[20:24, 0:5] = 0.0
sigma = 0.05 + 0.1 * rng.random((H, W)) * np.abs(prediction)
truth, prediction, sigma = (np.round(m, 7) for m in (truth, prediction, sigma))
inputs = {"truth": truth, "prediction": prediction, "sigma": sigma}
inputs = {k: m.tolist() for k, m in inputs.items()}
# The maps are 32-bit floats there.
truth, prediction, sigma = (m.astype(np.float32).astype(float) for m in (truth, prediction, sigma))
mask = truth > 0

# Alignments.
p, g, s = prediction[mask], truth[mask], sigma[mask]
scale = np.median(g) / np.median(p)
depth_fit = np.linalg.lstsq(np.stack([p, np.ones_like(p)], 1), g, rcond=None)[0]
disparity_fit = np.linalg.lstsq(np.stack([1 / p, np.ones_like(p)], 1), 1 / g, rcond=None)[0]
aligned_disparity = 1 / np.maximum(disparity_fit[0] / p + disparity_fit[1], 1 / g.max())

# Everything else is under the median's alignment, rounded to 32 bits as a map is.
aligned = (prediction * scale).astype(np.float32).astype(float)
p, s = aligned[mask], s * scale
out = {
    "median": scale,
    "median-ratio": np.median(g / prediction[mask]),
    "ls-depth": depth_fit.tolist(),
    "ls-disparity": disparity_fit.tolist(),
    "ls-disparity-rmse": sk.root_mean_squared_error(g, aligned_disparity),
    "mse": sk.mean_squared_error(g, p),
    "rmse": sk.root_mean_squared_error(g, p),
    "abs-rel": sk.mean_absolute_percentage_error(g, p),
    "sq-rel": np.mean((g - p) ** 2 / g),
    "rmse-log": sk.root_mean_squared_error(np.log(g), np.log(p)),
    "log10": sk.mean_absolute_error(np.log10(g), np.log10(p)),
    "silog": 100 * np.std(np.log(p) - np.log(g)),
    "irmse": sk.root_mean_squared_error(1 / g, 1 / p),
    "delta": [float(np.mean(np.maximum(g / p, p / g) < 1.25**k)) for k in (1, 2, 3)],
}

# Edges. ndimage.sobel is the same kernel up to sign; "nearest" replicates the border.
filled = np.where(mask, truth, 0.0)
predicted = np.where(mask, aligned, 0.0)


def gradient(m):
    return np.hypot(*(ndimage.sobel(m, axis, mode="nearest") for axis in (0, 1)))


inside = ndimage.binary_erosion(mask, np.ones((3, 3)), border_value=1)
gp = np.where(inside, gradient(predicted), 0)
gg = np.where(inside, gradient(filled), 0)


def distance(edges):
    return ndimage.distance_transform_edt(~edges) if edges.any() else np.full(edges.shape, np.inf)


def f1(ep, eg, r):
    precision = (distance(eg)[ep] <= r).mean() if ep.any() else 0.0
    recall = (distance(ep)[eg] <= r).mean() if eg.any() else 0.0
    return precision, recall, 2 * precision * recall / (precision + recall) if precision + recall else 0.0


out["edges"] = []
for threshold in (0.25, 0.5, 1.0):
    for r in (0, 1, 2):
        eg = gg > threshold
        sweep = [f1(gp >= t, eg, r) for t in np.unique(gp[gp > 0])[::-1]]
        fixed = [float(v) for v in f1(gp > threshold, eg, r)]
        best = float(max(q[2] for q in sweep))
        out["edges"].append({"threshold": threshold, "tolerance": r, "fixed": fixed, "max": best})
slope = gp[inside] / 8 / np.median(p)
near = (distance(gg > 0.5) <= 3)[inside]
out["sharpness"] = [float(slope.mean()), float(slope[near].mean()), float(slope[~near].mean())]


def boundary_f1():
    cp, cg = (1 / np.maximum(np.where(mask, m, 1), 1e-6) for m in (aligned, truth))
    ts = np.linspace(1.05, 1.25, 10)
    total = 0.0
    for t in ts:
        hits = []
        for axis in (0, 1):
            for step in (1, -1):
                def ahead(m):
                    sl = [slice(None)] * 2
                    sl[axis] = slice(1, None) if step == 1 else slice(None, -1)
                    other = [slice(None)] * 2
                    other[axis] = slice(None, -1) if step == 1 else slice(1, None)
                    return m[tuple(sl)], m[tuple(other)]

                both = np.logical_and(*ahead(mask))
                bp, bg = ((a / b > t) & both for a, b in (ahead(cp), ahead(cg)))
                tp = (bp & bg).sum()
                hits.append((tp / max(bp.sum(), 1), tp / max(bg.sum(), 1)))
        precision, recall = np.mean(hits, axis=0)
        total += t * (2 * precision * recall / (precision + recall) if precision + recall else 0)
    return total / ts.sum()


out["boundary-f1"] = boundary_f1()


# Canny's edges of the depth scaled to [0, 1], and distances between them (iBims-1).
def boundaries(m):
    scaled = np.where(mask, (m - m[mask].min()) / (m[mask].max() - m[mask].min()), 0)
    return canny(scaled, sigma=np.sqrt(2), low_threshold=0.15, high_threshold=0.3, mask=mask)


ep, eg = boundaries(aligned), boundaries(truth)
out["canny"] = [np.flatnonzero(m.ravel()).tolist() for m in (ep, eg)]
dg, dp = distance(eg), distance(ep)
near_enough = dg[ep] < 10
out["dbe"] = [dg[ep][near_enough].mean(), (np.minimum(dg[ep], 10).sum() + np.minimum(dp[eg], 10).sum()) / (ep.sum() + eg.sum())]


order = lambda a, b, t: np.sign(a - b) * (np.maximum(a / b, b / a) > t)
# So few pixels that each is a superpixel of its own: all neighbours over an edge of a pixel.
grid = np.arange(H * W).reshape(H, W)
near = np.concatenate([np.stack([grid[:-1], grid[1:]], -1).reshape(-1, 2), np.stack([grid[:, :-1], grid[:, 1:]], -1).reshape(-1, 2)])
near = near[mask.ravel()[near].all(1)]
# The aligned map has them all in order, another map does not.
ga, gb, pa, pb = (m.ravel()[near[:, k]] for m in (truth, sigma) for k in (0, 1))
keep = np.maximum(ga / gb, gb / ga) > 1.1
out["d3r"] = float(np.mean((order(ga, gb, 1.01) != order(pa, pb, 1.01))[keep]))

# Uncertainty.
e = p - g
# The published sparsifications break ties by index, so there must be none.
assert np.unique(s).size == s.size and np.unique(np.abs(e)).size == s.size
rough = np.round(s, 2)
out["spearman"] = stats.spearmanr(s, np.abs(e)).statistic
out["spearman-ties"] = stats.spearmanr(rough, np.abs(e)).statistic
out["ranks-ties"] = float(np.sum(stats.rankdata(rough) * np.arange(rough.size)))


def rays(cost, root):
    reduce = (lambda v: np.sqrt(v.mean())) if root else np.mean
    r = np.linspace(0, 1, 100, endpoint=False)
    curves = []
    for key in (s, cost):
        ordered = cost[np.argsort(key)]
        curves.append(np.array([reduce(ordered[: int((1 - k) * cost.size)]) for k in r]))
    top = max(c.max() for c in curves)
    return float(np.trapezoid((curves[0] - curves[1]) / top, r))


out["rays-mae"], out["rays-rmse"] = rays(np.abs(e), False), rays(e**2, True)
out["nll"] = -stats.norm.logpdf(g, p, s).mean()
# The definition, integrated: the squared distance between the predicted and the true distribution function.
crps = lambda mu, sd, t: (
    integrate.quad(lambda v: stats.norm.cdf(v, mu, sd) ** 2, mu - 12 * sd, t, limit=200)[0]
    + integrate.quad(lambda v: stats.norm.sf(v, mu, sd) ** 2, t, max(mu + 12 * sd, t), limit=200)[0]
)
out["crps-first"] = float(np.mean([crps(*v) for v in zip(p[:40], s[:40], g[:40])]))
inside = lambda q: float(np.mean(np.abs(e) <= s * stats.norm.ppf(0.5 + q / 2)))
out["coverage"] = [inside(q) for q in (0.5, 0.68, 0.9, 0.95)]
out["mean-z2"] = np.mean((e / s) ** 2)

with open("metrics.json", "w") as file:
    json.dump({"inputs": inputs, "expected": out}, file, default=float)
    file.write("\n")
