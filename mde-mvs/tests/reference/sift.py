"""Writes sift.csv: elongated blobs that make a picture, and OpenCV's keypoints and descriptors of it.

Python 3.11, numpy==2.4.6, opencv-python-headless==5.0.0.93
Run: python sift.py (in this folder)
"""

import cv2
import numpy as np

W, H = 200, 150
rng = np.random.default_rng(20261203)
count = 160
blobs = np.stack(
    [
        rng.uniform(0, W, count),
        rng.uniform(0, H, count),
        np.exp(rng.uniform(np.log(1.2), np.log(9), count)),
        np.exp(rng.uniform(np.log(1.2), np.log(9), count)),
        rng.uniform(0, np.pi, count),
        rng.uniform(-0.3, 0.3, count),
    ],
    1,
).round(4)
y, x = np.mgrid[0:H, 0:W].astype(float)
image = np.full((H, W), 0.5)
for u, v, a, b, angle, height in blobs:
    p = (x - u) * np.cos(angle) + (y - v) * np.sin(angle)
    q = (y - v) * np.cos(angle) - (x - u) * np.sin(angle)
    image += height * np.exp(-0.5 * ((p / a) ** 2 + (q / b) ** 2))
image = np.floor(np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)

sift = cv2.SIFT_create(0, 3, 0.02, 10, 1.6, True)
keypoints, descriptors = sift.detectAndCompute(image, None)
with open("sift.csv", "w") as out:
    for row in blobs:
        print("blob", *row, sep=",", file=out)
    for keypoint, row in zip(keypoints, descriptors):
        # OpenCV's directions run from the column axis to the negative row axis.
        row = row.reshape(16, 8)[:, [0, 7, 6, 5, 4, 3, 2, 1]].ravel()
        place = [*keypoint.pt, keypoint.size, keypoint.angle, keypoint.response]
        print("keypoint", *(f"{v:.4f}" for v in place), *row.astype(int), sep=",", file=out)
print(len(keypoints), "keypoints")
