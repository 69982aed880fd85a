"""Makes the tiny ONNX models of tests/fixtures, and what ONNX Runtime answers to them.

python -m pip install onnx onnxruntime numpy && python make_models.py ../fixtures
"""

import pathlib
import sys

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

FOLDER = pathlib.Path(sys.argv[1])
GREY = np.array([0.299, 0.587, 0.114], np.float32)


def constant(name, value):
    return numpy_helper.from_array(np.asarray(value), name)


def save(name, nodes, inputs, outputs, constants):
    def infos(pairs):
        return [helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in pairs]

    graph = helper.make_graph(nodes, name, infos(inputs), infos(outputs), constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, FOLDER / f"{name}.onnx")


def midas(name, shape):
    """A strided convolution, a bilinear resize back to a size computed from the input, squeezed to [1, H, W]."""
    rng = np.random.default_rng(7)
    weights = (GREY[None, :, None, None] * rng.uniform(0.5, 1.5, (4, 3, 3, 3))).astype(np.float32)
    nodes = [
        helper.make_node("Conv", ["image", "w1"], ["c1"], strides=[2, 2], pads=[1, 1, 1, 1]),
        helper.make_node("Relu", ["c1"], ["r1"]),
        helper.make_node("Shape", ["image"], ["shape"]),
        helper.make_node("Slice", ["shape", "two", "four"], ["sides"]),
        helper.make_node("Concat", ["batch", "sides"], ["size"], axis=0),
        helper.make_node("Resize", ["r1", "", "", "size"], ["up"], mode="linear",
                         coordinate_transformation_mode="pytorch_half_pixel"),
        helper.make_node("Conv", ["up", "w2", "b2"], ["c2"]),
        helper.make_node("Squeeze", ["c2", "one"], ["disparity"]),
    ]
    constants = [
        constant("w1", weights),
        constant("w2", rng.normal(size=(1, 4, 1, 1)).astype(np.float32)),
        constant("b2", np.array([-2.5], np.float32)),
        constant("two", np.array([2], np.int64)),
        constant("four", np.array([4], np.int64)),
        constant("batch", np.array([1, 4], np.int64)),
        constant("one", np.array([1], np.int64)),
    ]
    save(name, nodes, [("image", shape)], [("disparity", [1, shape[2], shape[3]])], constants)


def grey(name, shape, output, layout="nchw"):
    """Weighted sum of the channels: depth of each pixel as a known function of its colour."""
    axis, weights = (1, GREY[:, None, None]) if layout == "nchw" else (3, GREY)
    nodes = [
        helper.make_node("Mul", ["image", "w"], ["m"]),
        helper.make_node("ReduceSum", ["m", "axis"], ["depth"], keepdims=1),
    ]
    constants = [constant("w", weights), constant("axis", np.array([axis], np.int64))]
    save(name, nodes, [("image", shape)], [("depth", output)], constants)


midas("midas_small", [1, 3, 32, 32])
midas("midas_dynamic", [1, 3, "height", "width"])
grey("grey_nchw", [1, 3, "height", "width"], [1, 1, "height", "width"])
grey("grey_nhwc", [1, 8, 12, 3], [1, 8, 12, 1], "nhwc")

# Whatever the image, larger below, as the disparity of rooms is.
save("rows", [helper.make_node("ReduceSum", ["image", "axis"], ["s"], keepdims=1), helper.make_node("Mul", ["s", "zero"], ["z"]),
              helper.make_node("Add", ["z", "rows"], ["out"])],
     [("image", [1, 3, 24, 32])], [("out", [1, 1, 24, 32])],
     [constant("axis", np.array([1], np.int64)), constant("zero", np.zeros(1, np.float32)),
      constant("rows", np.linspace(0.5, 2.5, 24, dtype=np.float32)[None, None, :, None])])

# Not depth: the colours as they came, a row of class scores, an input of one channel, a vector.
save("three_channels", [helper.make_node("Identity", ["image"], ["out"])],
     [("image", [1, 3, 8, 8])], [("out", [1, 3, 8, 8])], [])
save("scores", [helper.make_node("GlobalAveragePool", ["image"], ["p"]), helper.make_node("Flatten", ["p"], ["out"])],
     [("image", [1, 3, 8, 8])], [("out", [1, 3])], [])
save("one_channel", [helper.make_node("Identity", ["image"], ["out"])],
     [("image", [1, 1, 8, 8])], [("out", [1, 1, 8, 8])], [])
save("vector", [helper.make_node("Identity", ["image"], ["out"])], [("image", [8])], [("out", [8])], [])
save("not_finite", [helper.make_node("ReduceSum", ["image", "axis"], ["s"]), helper.make_node("Sub", ["s", "s"], ["z"]),
                    helper.make_node("Div", ["z", "z"], ["out"])],
     [("image", [1, 3, 8, 8])], [("out", [1, 1, 8, 8])], [constant("axis", np.array([1], np.int64))])

# Weights in a file of their own.
def external(name):
    weights = numpy_helper.from_array(np.full((1, 3, 1, 1), 1 / 3, np.float32), "w")
    nodes = [helper.make_node("Conv", ["image", "w"], ["depth"])]
    graph = helper.make_graph(nodes, name, [helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, "h", "w"])],
                              [helper.make_tensor_value_info("depth", TensorProto.FLOAT, [1, 1, "h", "w"])], [weights])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    (FOLDER / f"{name}.bin").unlink(missing_ok=True)
    onnx.save(model, FOLDER / f"{name}.onnx", save_as_external_data=True, location=f"{name}.bin", size_threshold=0)


external("external")


# Graphs that no runtime can run, some of which panic in tract. The checker refuses them, so they are not checked.
def broken(name, nodes, constants=()):
    sides = [1, 3, 16, 16]
    graph = helper.make_graph(nodes, name, [helper.make_tensor_value_info("image", TensorProto.FLOAT, sides)],
                              [helper.make_tensor_value_info("depth", TensorProto.FLOAT, None)], list(constants))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, FOLDER / f"{name}.onnx")


def integers(name, *values):
    return constant(name, np.array(values, np.int64))


KERNEL = constant("k", np.ones((1, 3, 3, 3), np.float32))
broken("stride_0", [helper.make_node("Conv", ["image", "k"], ["depth"], strides=[0, 0])], [KERNEL])
broken("axis_99", [helper.make_node("ReduceMean", ["image"], ["depth"], axes=[99])])
broken("step_0", [helper.make_node("Slice", ["image", "a", "b", "c", "d"], ["depth"])],
       [integers("a", 0), integers("b", 16), integers("c", 2), integers("d", 0)])
broken("divided_by_0", [helper.make_node("Shape", ["image"], ["shape"]), helper.make_node("Div", ["shape", "zero"], ["sides"]),
                        helper.make_node("Reshape", ["image", "sides"], ["depth"])], [integers("zero", 0)])
broken("huge", [helper.make_node("Tile", ["image", "times"], ["depth"])], [integers("times", 1, 1, 1 << 20, 1 << 20)])
broken("enlarged", [helper.make_node("Resize", ["image", "", "scales"], ["depth"])],
       [constant("scales", np.array([1, 1, 1e5, 1e5], np.float32))])
# 60 convolutions of 31x31: minutes at 1024x1024.
BOX = constant("box", np.full((1, 1, 31, 31), 1 / 961, np.float32))
names = ["grey", *(f"s{i}" for i in range(60))]
nodes = [helper.make_node("ReduceMean", ["image"], ["grey"], axes=[1])]
nodes += [helper.make_node("Conv", [a, "box"], [b], pads=[15] * 4) for a, b in zip(names, names[1:])]
graph = helper.make_graph(nodes, "slow", [helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, "h", "w"])],
                          [helper.make_tensor_value_info(names[-1], TensorProto.FLOAT, [1, 1, "h", "w"])], [BOX])
onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), FOLDER / "slow.onnx")

# Four convolutions of 3x3, of 3, 48, 48 and 1 channels: matrix products that tract shares out between threads.
nodes, constants = [], []
for layer, (inputs, outputs) in enumerate([(3, 48), (48, 48), (48, 48), (48, 1)]):
    constants.append(integers(f"sides{layer}", outputs, inputs, 3, 3))
    value = numpy_helper.from_array(np.array([1 / (9 * inputs)], np.float32))
    nodes.append(helper.make_node("ConstantOfShape", [f"sides{layer}"], [f"w{layer}"], value=value))
    nodes.append(helper.make_node("Conv", [f"c{layer}", f"w{layer}"], [f"c{layer + 1}"], pads=[1] * 4))
graph = helper.make_graph(nodes, "convolutions", [helper.make_tensor_value_info("c0", TensorProto.FLOAT, [1, 3, 96, 96])],
                          [helper.make_tensor_value_info("c4", TensorProto.FLOAT, [1, 1, 96, 96])], constants)
onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), FOLDER / "convolutions.onnx")

broken("groups", [helper.make_node("Conv", ["image", "k"], ["depth"], group=7)], [KERNEL])
broken("split", [helper.make_node("Split", ["image", "parts"], ["depth", "rest"], axis=1)], [integers("parts", 5, -2)])

# The answer of an independent runtime to a stated image, at the fixed and at another size.
for name, (height, width) in {"midas_small": (32, 32), "midas_dynamic": (64, 96)}.items():
    y, x, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(3), indexing="ij")
    image = (((7 * y + 3 * x + 5 * c) % 32) / 31).astype(np.float32)
    session = onnxruntime.InferenceSession(FOLDER / f"{name}.onnx")
    (out,) = session.run(None, {"image": image.transpose(2, 0, 1)[None]})
    np.save(FOLDER / f"{name}.npy", out[0])


def published(name, nodes, inputs, outputs, constants):
    """A graph with the inputs and outputs of a published network; pairs are (name, type, shape)."""
    def infos(triples):
        return [helper.make_tensor_value_info(n, t, s) for n, t, s in triples]

    graph = helper.make_graph(nodes, name, infos(inputs), infos(outputs), constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, FOLDER / f"{name}.onnx")


F, I = TensorProto.FLOAT, TensorProto.INT64
GREY_NODES = [
    helper.make_node("Mul", ["image", "w"], ["m"]),
    helper.make_node("ReduceSum", ["m", "axis"], ["grey"], keepdims=1),
    helper.make_node("Add", ["grey", "one"], ["z"]),
]
GREY_CONSTANTS = [
    constant("w", GREY[:, None, None]), constant("axis", np.array([1], np.int64)), constant("one", np.float32([1.0])),
]
H, W = 28, 42
v, u = np.mgrid[:H, :W].astype(np.float32)
diagonal = np.hypot(H, W)
RAYS = np.stack([(2 * u + 1 - W) / diagonal, (2 * v + 1 - H) / diagonal])[None].astype(np.float32)

# MoGe-2: points with an unknown shift of depth, a mask, a scale; a number of tokens beside the image. Here z = 1 + grey, the focal
# length 0.8 of the diagonal, the points 0.4 too near, the scale tokens / 1000, and dark pixels masked.
published(
    "moge2",
    GREY_NODES + [
        helper.make_node("Mul", ["rays", "z"], ["xy"]),
        helper.make_node("Sub", ["z", "shift"], ["near"]),
        helper.make_node("Concat", ["xy", "near"], ["chw"], axis=1),
        helper.make_node("Transpose", ["chw"], ["points"], perm=[0, 2, 3, 1]),
        helper.make_node("Identity", ["points"], ["normal"]),
        helper.make_node("Greater", ["grey", "dark"], ["bright"]),
        helper.make_node("Cast", ["bright"], ["masks"], to=F),
        helper.make_node("Squeeze", ["masks", "axis"], ["mask"]),
        helper.make_node("Cast", ["num_tokens"], ["tokens"], to=F),
        helper.make_node("Mul", ["tokens", "thousandth"], ["scale"]),
        helper.make_node("Reshape", ["scale", "axis"], ["metric_scale"]),
    ],
    [("image", F, [1, 3, H, W]), ("num_tokens", I, [])],
    [("points", F, [1, H, W, 3]), ("normal", F, [1, H, W, 3]), ("mask", F, [1, H, W]), ("metric_scale", F, [1])],
    GREY_CONSTANTS + [
        constant("rays", RAYS / np.float32(0.8)), constant("shift", np.float32([0.4])), constant("dark", np.float32([0.2])),
        constant("thousandth", np.float32([0.001])),
    ],
)
K = np.float32([[[30, 0, 20], [0, 31, 15], [0, 0, 1]]])
# UniDepth V2: points in metres, channels first; confidence and intrinsics beside them.
published(
    "unidepth",
    GREY_NODES + [
        helper.make_node("Mul", ["rays", "z"], ["xy"]),
        helper.make_node("Concat", ["xy", "z"], ["pts_3d"], axis=1),
        helper.make_node("Identity", ["grey"], ["confidence"]),
        helper.make_node("Identity", ["k"], ["intrinsics"]),
    ],
    [("image", F, [1, 3, H, W])],
    [("pts_3d", F, [1, 3, H, W]), ("confidence", F, [1, 1, H, W]), ("intrinsics", F, [1, 3, 3])],
    GREY_CONSTANTS + [constant("rays", RAYS), constant("k", K)],
)
# The same from its older export: the intrinsics first, then metres.
published(
    "unidepth_k",
    GREY_NODES + [
        helper.make_node("Identity", ["k"], ["out_K"]),
        helper.make_node("Identity", ["z"], ["depth"]),
        helper.make_node("Identity", ["grey"], ["depth_ssi"]),
        helper.make_node("Identity", ["grey"], ["confidence"]),
    ],
    [("image", F, [1, 3, H, W])],
    [("out_K", F, [1, 3, 3]), ("depth", F, [1, 1, H, W]), ("depth_ssi", F, [1, 1, H, W]), ("confidence", F, [1, 1, H, W])],
    GREY_CONSTANTS + [constant("k", K)],
)
# Depth Pro: metres, and the focal length.
published(
    "depth_pro_like",
    GREY_NODES + [
        helper.make_node("Squeeze", ["z", "axis"], ["predicted_depth"]),
        helper.make_node("Identity", ["f"], ["focallength_px"]),
    ],
    [("image", F, [1, 3, H, W])],
    [("predicted_depth", F, [1, H, W]), ("focallength_px", F, [1, 1])],
    GREY_CONSTANTS + [constant("f", np.float32([[50.0]]))],
)
# Metric3D v2: depth for a focal length of 1000 pixels, and normals.
published(
    "metric3d",
    [helper.make_node("Identity", ["pixel_values"], ["image"])] + GREY_NODES
    + [helper.make_node("Identity", ["z"], ["predicted_depth"]), helper.make_node("Identity", ["image"], ["predicted_normal"]),
       helper.make_node("Identity", ["grey"], ["normal_confidence"])],
    [("pixel_values", F, [1, 3, "height", "width"])],
    [("predicted_depth", F, [1, 1, "height", "width"]), ("predicted_normal", F, [1, 3, "height", "width"]),
     ("normal_confidence", F, [1, 1, "height", "width"])],
    GREY_CONSTANTS,
)
# Depth Anything and its relatives as Transformers exports them.
published(
    "predicted_depth",
    [helper.make_node("Identity", ["pixel_values"], ["image"])] + GREY_NODES
    + [helper.make_node("Squeeze", ["z", "axis"], ["predicted_depth"])],
    [("pixel_values", F, [1, 3, "height", "width"])],
    [("predicted_depth", F, [1, "height", "width"])],
    GREY_CONSTANTS,
)
# Depth Pro as Transformers and Apple's network give it: inverse depth for a focal length of the width, and the field of view in degrees.
for name, depth, fov in [("depth_pro_inverse", "predicted_depth", "field_of_view"),
                         ("depth_pro_apple", "canonical_inverse_depth", "fov_deg")]:
    published(
        name,
        GREY_NODES + [
            helper.make_node("Squeeze", ["z", "axis"], [depth]),
            helper.make_node("Identity", ["f"], [fov]),
        ],
        [("image", F, [1, 3, H, W])],
        [(depth, F, [1, H, W]), (fov, F, [1])],
        GREY_CONSTANTS + [constant("f", np.float32([60.0]))],
    )
# FastDepth's layers, as many and of the same kernels: MobileNet's, then those of its decoder. Each keeps the picture's three channels.
names = ["image", *(f"a{i}" for i in range(13)), *(f"b{i}" for i in range(5))]
published(
    "fastdepth_like",
    [helper.make_node("Conv", [a, "k3" if b[0] == "a" else "k5"], [b], group=3, pads=[1 if b[0] == "a" else 2] * 4,
                      kernel_shape=[3, 3] if b[0] == "a" else [5, 5]) for a, b in zip(names, names[1:])]
    + [helper.make_node("Conv", [names[-1], "grey"], ["depth"], kernel_shape=[1, 1])],
    [("image", F, [1, 3, 224, 224])],
    [("depth", F, [1, 1, 224, 224])],
    [constant("k3", np.full((3, 1, 3, 3), 1 / 9, np.float32)), constant("k5", np.full((3, 1, 5, 5), 1 / 25, np.float32)),
     constant("grey", 5 * GREY[None, :, None, None])],
)
