"""Writes baselines.json: a small picture with depth, and what direct implementations of the filters make of it.

Python 3.11, numpy==2.4.6, scipy==1.17.1
Run: python baselines.py (in this folder)
"""

import json

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse import linalg

H, W = 24, 32
rng = np.random.default_rng(20261121)
y, x = np.mgrid[0:H, 0:W]
image = np.stack([0.5 + 0.3 * np.sin(x / 6.0 + c) * np.cos(y / 8.0) for c in range(3)], 2)
image[8:18, 10:22] = [0.8, 0.3, 0.2]
image = np.clip(image + 0.02 * rng.standard_normal((H, W, 3)), 0, 1)
depth = 3.0 + 0.02 * x
depth[8:18, 10:22] = 1.5
depth = ndimage.gaussian_filter(depth, 1.5)
depth[rng.random((H, W)) < 0.05] = 0.0
confidence = np.where(depth > 0, rng.random((H, W)), 0.0)
image, depth, confidence = (np.round(m, 6).astype(np.float32).astype(float) for m in (image, depth, confidence))
known = depth > 0


def window(v, u, r):
    return slice(max(v - r, 0), v + r + 1), slice(max(u - r, 0), u + r + 1)


def each(of):
    return np.array([[of(v, u) if known[v, u] else 0.0 for u in range(W)] for v in range(H)])


def guided(r=12, eps=1e-3):
    # One regression a window over its known pixels.
    lines = np.zeros((H, W, 4))
    for v in range(H):
        for u in range(W):
            w = window(v, u, r)
            keep = known[w]
            c, d = image[w][keep], depth[w][keep]
            slope = np.linalg.solve(np.cov(c.T, bias=True) + eps * np.eye(3), ((c - c.mean(0)).T @ (d - d.mean())) / len(d))
            lines[v, u] = [*slope, d.mean() - slope @ c.mean(0)]

    def pixel(v, u):
        w = window(v, u, r)
        line = lines[w][known[w]].mean(0)
        return line[:3] @ image[v, u] + line[3]

    return each(pixel)


def colour_weights(v, u, w, sigma):
    return np.exp(-((image[w] - image[v, u]) ** 2).sum(2) / (2 * sigma**2)) * known[w]


def unsharp(amount=1.0, sigma=8.0):
    logs = np.log(np.where(known, depth, 1.0))
    blur = lambda m: ndimage.gaussian_filter(m, sigma, mode="constant", truncate=4.0)
    mean = blur(logs) / blur(known.astype(float))
    return np.where(known, np.exp(logs + amount * (logs - mean)), 0.0)


def fbs(lam=128.0):
    rgb = 255 * image
    luma = rgb @ [0.299, 0.587, 0.114]
    yuv = [luma, 128 + 0.564 * (rgb[..., 2] - luma), 128 + 0.713 * (rgb[..., 0] - luma)]
    coordinates = np.stack([np.floor(c / s) for c, s in zip([y, x, *yuv], [8, 8, 4, 4, 4])], 2).reshape(-1, 5).astype(int)
    vertices, inverse = np.unique(coordinates, axis=0, return_inverse=True)
    inverse = inverse.ravel()
    n = len(vertices)
    splat = sparse.csr_matrix((np.ones(H * W), (inverse, np.arange(H * W))), (n, H * W))
    index = {tuple(v): k for k, v in enumerate(vertices)}
    blur = sparse.lil_matrix((n, n))
    blur.setdiag(10)
    for k, v in enumerate(vertices):
        for axis in range(5):
            for step in (-1, 1):
                other = list(v)
                other[axis] += step
                if tuple(other) in index:
                    blur[k, index[tuple(other)]] = 1
    blur = blur.tocsr()
    m = splat @ np.ones(H * W)
    scale = np.ones(n)
    for _ in range(10):
        scale = np.sqrt(scale * m / (blur @ scale))
    m = scale * (blur @ scale)
    dn = sparse.diags(scale)
    c, t = confidence.ravel(), depth.ravel()
    a = lam * (sparse.diags(m) - dn @ blur @ dn) + sparse.diags(splat @ c + 1e-9)
    return (splat.T @ linalg.spsolve(a.tocsc(), splat @ (c * t))).reshape(H, W)


expected = {"guided": guided(), "unsharp1": unsharp(), "fbs": fbs()}
out = {
    "image": [np.round(image[..., c], 6).tolist() for c in range(3)],
    "depth": np.round(depth, 6).tolist(),
    "confidence": np.round(confidence, 6).tolist(),
    "expected": {name: np.round(m, 6).tolist() for name, m in expected.items()},
}
with open("baselines.json", "w") as file:
    json.dump(out, file)
    file.write("\n")
