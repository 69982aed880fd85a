"""The fields of `mde bench` in JAX: same sizes, same batch, same losses, Adam, jitted; prints one JSON object.

Samples a second of a training step: encoding, networks, compositing, gradients and update. Positions are drawn outside the step.
"""
import argparse
import json
import time

import jax
import jax.numpy as jnp
import numpy as np

RAYS, SAMPLES = 1024, 48
PRIMES = (2654435761, 805459861, 1)


def levels_of(levels, coarsest=16, finest=640):
    growth = (finest / coarsest) ** (1 / (levels - 1))
    return [int(coarsest * growth**i + 1e-6) for i in range(levels)]


def dense(key, widths):
    layers = []
    for fan_in, fan_out in zip(widths, widths[1:]):
        key, use = jax.random.split(key)
        bound = (6 / fan_in) ** 0.5
        layers.append((jax.random.uniform(use, (fan_in, fan_out), jnp.float32, -bound, bound), jnp.zeros(fan_out)))
    return layers


def network(layers, x):
    for weights, bias in layers[:-1]:
        x = jax.nn.relu(x @ weights + bias)
    return x @ layers[-1][0] + layers[-1][1]


def hash_encode(table, points, cells, log2_rows):
    rows = 1 << log2_rows
    features = []
    for level, n in enumerate(cells):
        x = points * n
        low = jnp.clip(x.astype(jnp.uint32), 0, n - 1)
        part = x - low
        total = 0.0
        for corner in range(8):
            bits = [(corner >> axis) & 1 for axis in range(3)]
            at = [low[:, axis] + jnp.uint32(bits[axis]) for axis in range(3)]
            if (n + 1) ** 3 <= rows:
                index = (at[1] * (n + 1) + at[0]) * (n + 1) + at[2]
            else:
                index = at[0] * jnp.uint32(PRIMES[0]) ^ at[1] * jnp.uint32(PRIMES[1]) ^ at[2]
                index = index & jnp.uint32(rows - 1)
            weight = 1.0
            for axis in range(3):
                weight = weight * (part[:, axis] if bits[axis] else 1 - part[:, axis])
            total = total + weight[:, None] * table[level, index]
        features.append(total)
    return jnp.concatenate(features, axis=1)


def frequency_encode(points, octaves=10):
    q = 2 * points - 1
    angles = [q * (np.pi * 2**k) for k in range(octaves)]
    return jnp.concatenate([q] + [f(a) for a in angles for f in (jnp.sin, jnp.cos)], axis=1)


def field(name):
    key = jax.random.PRNGKey(0)
    if name == "mlp-4x128":
        parameters = {"density": dense(key, [63, 128, 128, 128, 128, 4])}
        return parameters, lambda p, x: network(p["density"], frequency_encode(x))
    levels, features, log2_rows = 8, 4, 16
    cells = levels_of(levels)
    table = jax.random.uniform(key, (levels, 1 << log2_rows, features), jnp.float32, -1e-4, 1e-4)
    parameters = {"table": table, "density": dense(key, [32, 32, 32, 4])}
    return parameters, lambda p, x: network(p["density"], hash_encode(p["table"], x, cells, log2_rows))


def loss_of(shade):
    def loss(parameters, points, extent, target):
        raw = shade(parameters, points.reshape(-1, 3)).reshape(RAYS, SAMPLES, 4)
        density, colour = jnp.exp(raw[..., 0]), jax.nn.sigmoid(raw[..., 1:])
        keep = jnp.exp(-density * extent)
        behind = jnp.cumprod(keep, axis=1)
        weights = jnp.concatenate([jnp.ones((RAYS, 1)), behind[:, :-1]], axis=1) * (1 - keep)
        rendered = (weights[..., None] * colour).sum(axis=1) + behind[:, -1:] * 0.5
        return ((rendered - target) ** 2).mean()

    return loss


def step_of(loss):
    @jax.jit
    def step(parameters, first, second, count, points, extent, target):
        gradient = jax.grad(loss)(parameters, points, extent, target)
        first = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, first, gradient)
        second = jax.tree.map(lambda v, g: 0.99 * v + 0.01 * g * g, second, gradient)
        fix1, fix2 = 1 - 0.9**count, 1 - 0.99**count
        update = lambda p, m, v: p - 5e-3 * (m / fix1) / (jnp.sqrt(v / fix2) + 1e-15)
        return jax.tree.map(update, parameters, first, second), first, second

    return step


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--steps", type=int, default=10)
    steps = options.parse_args().steps
    rng = np.random.default_rng(0)
    points = np.sort(rng.random((RAYS, SAMPLES, 3), np.float32), axis=1)
    extent = np.full((RAYS, SAMPLES), 1 / SAMPLES, np.float32)
    target = rng.random((RAYS, 3), np.float32)
    rates = {}
    for name in ["hash-8x4", "mlp-4x128"]:
        parameters, shade = field(name)
        step = step_of(loss_of(shade))
        state = (parameters, *[jax.tree.map(jnp.zeros_like, parameters) for _ in range(2)])
        state = jax.block_until_ready(step(*state, 1.0, points, extent, target))
        seconds = []
        for count in range(steps):
            start = time.perf_counter()
            state = jax.block_until_ready(step(*state, count + 2.0, points, extent, target))
            seconds.append(time.perf_counter() - start)
        rates[name] = RAYS * SAMPLES / float(np.median(seconds))
    print(json.dumps({"jax": jax.__version__, "training_samples_a_second": rates}))


if __name__ == "__main__":
    main()
