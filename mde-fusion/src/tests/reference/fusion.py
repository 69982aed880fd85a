"""Reference values of reference.rs, by NumPy and no formula of the crate's own.

    python fusion.py > fusion.csv        (numpy >= 2)

Each line: name, then the values in row-major order; "inf" marks a missing pixel's variance.
"""
import numpy as np

rng = np.random.default_rng(20)
H, W, K = 9, 11, 4
truth = 2.0 + 0.3 * np.add.outer(np.arange(H), np.arange(W)) / 4 + (np.arange(W) > 5) * 0.8
prior = (truth + rng.normal(0, 0.15, (H, W))).astype(np.float32)
prior[rng.random((H, W)) < 0.08] = 0
sigma = 10 ** rng.uniform(-2.2, -0.6, (K, H, W))
view = ((truth - 0.3) / 1.1 + rng.normal(0, sigma)).astype(np.float32)
variance = (sigma**2).astype(np.float32)
variance[rng.random((K, H, W)) < 0.15] = np.inf
variance[:, 3, 4] = np.inf


def emit(name, values):
    print(name, *(repr(float(x)) for x in np.ravel(values)), sep=",")


emit("shape", [H, W, K])
emit("prior", prior)
emit("view", np.where(np.isfinite(variance), view, 0))
emit("variance", variance)

# Eq. 7-8 and the mixture's variance, pixel by pixel, by np.average.
agg, var, mix = np.zeros((H, W)), np.full((H, W), np.inf), np.full((H, W), np.inf)
for i in np.ndindex(H, W):
    known = np.isfinite(variance[(slice(None), *i)])
    if known.any():
        m, v = view[(slice(None), *i)][known].astype(float), variance[(slice(None), *i)][known].astype(float)
        agg[i], total = np.average(m, weights=1 / v, returned=True)
        var[i] = 1 / total
        mix[i] = np.average(v + (m - agg[i]) ** 2, weights=1 / v)
emit("aggregated-mean", agg)
emit("aggregated-variance", var)
emit("mixture-variance", mix)

X = np.isfinite(var) & (prior > 0)
u, v, c = agg[X], prior[X].astype(float), var[X]
a, b = np.polyfit(u, v, 1, w=1 / np.sqrt(c))  # polyfit's w multiplies the residual
emit("wls", [a, b])
p = 1 / c
cov = np.cov(u, v, aweights=p)
emit("diagnostics", [X.sum(), p.sum() ** 2 / (p**2).sum(), cov[0, 1] / np.sqrt(cov[0, 0] * cov[1, 1])])

delta, c = v - (a * u + b), a**2 * c
emit("delta", delta)
moments = max(0, np.mean(delta**2 - c))
emit("moments", moments)

# Eq. 16-17 as printed; the prior where no view reaches, nothing where the prior is missing.
aligned, spread = a * agg + b, a**2 * var
with np.errstate(divide="ignore", invalid="ignore"):
    w0, w1 = 1 / moments, 1 / spread
    refined = np.where(np.isfinite(spread), (w0 * prior + w1 * aligned) / (w0 + w1), prior)
    posterior = np.where(np.isfinite(spread), 1 / (w0 + w1), moments)
emit("refined", np.where(prior > 0, refined, 0))
emit("refined-variance", np.where(prior > 0, posterior, np.inf))
emit("sigma-o", np.sqrt(moments))
emit("nerf-weight", np.mean(w1[X] / (w0 + w1[X])))
emit("quantiles", np.quantile(var[np.isfinite(var)], [0.05, 0.25, 0.5, 0.75, 0.95]))
