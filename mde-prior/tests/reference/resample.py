"""Prints the reference values of tests/priors.rs: python -m pip install numpy opencv-python-headless pillow"""

import cv2
import numpy as np
from PIL import Image

print(cv2.resize(np.float32([[0, 0, 1, 0]]), (8, 1), interpolation=cv2.INTER_CUBIC).tolist())
print(np.asarray(Image.fromarray(np.float32([[0, 0, 4, 0]])).resize((2, 1), Image.BILINEAR)).tolist())
