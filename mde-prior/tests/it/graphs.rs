//! Graphs that are rewritten before tract reads them, and graphs that nothing should run.

use crate::{assert_close, fixture, pattern};
use mde_prior::ndarray::{Array2, Axis};
use mde_prior::{DepthKind, DepthPrior, ModelSpec, OnnxPrior};
use prost::Message;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tract_onnx::pb::attribute_proto::AttributeType;
use tract_onnx::pb::tensor_proto::DataType;
use tract_onnx::pb::tensor_shape_proto::{Dimension, dimension::Value::DimParam};
use tract_onnx::pb::type_proto::Value;
use tract_onnx::pb::{AttributeProto, GraphProto, ModelProto, NodeProto, TensorProto};
use tract_onnx::prelude::{Framework, f16};

const SIDE: usize = 16;

fn node(operator: &str, inputs: &[&str], output: &str, attributes: &[(&str, &[i64])]) -> NodeProto {
    let attribute = |&(name, values): &(&str, &[i64])| {
        let attribute = AttributeProto { name: name.to_owned(), ..AttributeProto::default() };
        match name {
            "axis" | "keepdims" | "training_mode" => {
                AttributeProto { r#type: AttributeType::Int as i32, i: values[0], ..attribute }
            }
            _ => AttributeProto { r#type: AttributeType::Ints as i32, ints: values.to_vec(), ..attribute },
        }
    };
    NodeProto {
        op_type: operator.to_owned(),
        input: inputs.iter().map(|name| (*name).to_owned()).collect(),
        output: vec![output.to_owned()],
        attribute: attributes.iter().map(attribute).collect(),
        ..NodeProto::default()
    }
}

fn weight(name: &str, dims: &[i64], kind: DataType, raw_data: Vec<u8>) -> TensorProto {
    let (name, dims, data_type) = (name.to_owned(), dims.to_vec(), kind as i32);
    TensorProto { name, dims, data_type, raw_data, ..TensorProto::default() }
}

fn floats(name: &str, dims: &[i64], values: &[f32]) -> TensorProto {
    weight(name, dims, DataType::Float, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

fn integers(name: &str, values: &[i64]) -> TensorProto {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    weight(name, &[values.len() as i64], DataType::Int64, bytes)
}

/// A network from `image` to `depth`, both of one size.
fn network(opset: i64, node: Vec<NodeProto>, initializer: Vec<TensorProto>) -> ModelProto {
    let tract = tract_onnx::onnx();
    let mut model = tract.proto_model_for_path(fixture("stride_0.onnx")).unwrap();
    model.opset_import[0].version = opset;
    let graph = model.graph.as_mut().unwrap();
    (graph.node, graph.initializer) = (node, initializer);
    model
}

fn saved(folder: &Path, model: &ModelProto) -> PathBuf {
    let path = folder.join("net.onnx");
    std::fs::write(&path, model.encode_to_vec()).unwrap();
    path
}

fn spec() -> ModelSpec {
    ModelSpec::new(SIDE, SIDE, DepthKind::AffineDisparity)
}

fn predicted(path: &Path) -> mde_prior::Result<Array2<f32>> {
    Ok(OnnxPrior::open(path, &spec())?.predict(pattern(SIDE, SIDE).view())?.map)
}

/// DPT's read-out projection and BiT's convolution of standardised weights, with the outputs that training has up to opset 13. The
/// read-out token, which is the mean colour, comes before or after the patches; with opset 18 the axis is counted from the first.
fn dpt_like(opset: i64, token_first: bool) -> ModelProto {
    let joined = if token_first { ["token", "patches"] } else { ["patches", "token"] };
    let statistics = if opset < 14 { ["mean", "variance"] } else { ["zero", "zero"] };
    let training: &[(&str, &[i64])] = if opset < 14 { &[] } else { &[("training_mode", &[1])] };
    let inputs = ["w", "scale", "shift", statistics[0], statistics[1]];
    let mut standardise = node("BatchNormalization", &inputs, "standard", training);
    let unread = ["running_mean", "running_variance", "saved_mean", "saved_variance"];
    let unread = &unread[..if opset < 14 { 4 } else { 2 }];
    standardise.output.extend(unread.iter().map(|name| (*name).to_owned()));
    let mean = |input: &str, output: &str, axes: &[i64]| match opset {
        ..18 => node("ReduceMean", &[input], output, &[("axes", axes), ("keepdims", &[1])]),
        _ => node("ReduceMean", &[input, &format!("axes{}", axes[0])], output, &[("keepdims", &[1])]),
    };
    let nodes = vec![
        node("Reshape", &["image", "rows"], "flat", &[]),
        node("Transpose", &["flat"], "patches", &[("perm", &[0, 2, 1])]),
        mean("patches", "readout", &[1]),
        node("Shape", &["patches"], "sides", &[]),
        node("Expand", &["readout", "sides"], "token", &[]),
        node("Concat", &joined, "joined", &[("axis", if opset < 18 { &[-1] } else { &[2] })]),
        node("MatMul", &["joined", "projection"], "projected", &[]),
        node("Reshape", &["projected", "map"], "projected map", &[]),
        standardise,
        node("Reshape", &["standard", "kernel"], "k", &[]),
        node("Conv", &["image", "k"], "convolved", &[]),
        node("Add", &["convolved", "projected map"], "depth", &[]),
    ];
    let side = SIDE as i64;
    let weights = vec![
        integers("rows", &[1, 3, side * side]),
        integers("axes1", &[1]),
        integers("map", &[1, 1, side, side]),
        integers("kernel", &[1, 3, 1, 1]),
        floats("projection", &[6, 1], &[0.5, -1.0, 2.0, 0.25, 3.0, -0.75]),
        floats("w", &[1, 1, 3], &[1.0, 2.0, 6.0]),
        floats("scale", &[1], &[1.5]),
        floats("shift", &[1], &[0.25]),
        floats("mean", &[1], &[3.0]),
        floats("variance", &[1], &[14.0 / 3.0]),
        floats("zero", &[1], &[0.0]),
    ];
    let mut model = network(opset, nodes, weights);
    let graph = model.graph.as_mut().unwrap();
    let mut joined = graph.input[0].clone();
    joined.name = "joined".to_owned();
    let Value::TensorType(tensor) = joined.r#type.as_mut().unwrap().value.as_mut().unwrap();
    // Named and not given, as in a hub's model_fp16.onnx.
    let side = Dimension { value: Some(DimParam("side".to_owned())), ..Dimension::default() };
    tensor.shape.as_mut().unwrap().dim = vec![side; 3];
    graph.value_info = vec![joined];
    model
}

/// What it computes.
fn dpt_like_map(token_first: bool) -> Array2<f32> {
    let (image, w) = (pattern(SIDE, SIDE), [0.5, -1.0, 2.0, 0.25, 3.0, -0.75]);
    let (token, patch) = if token_first { (0, 3) } else { (3, 0) };
    let colour = |c: usize| image.index_axis(Axis(2), c);
    let kernel = [1.0_f32, 2.0, 6.0].map(|v| (v - 3.0) / (14.0_f32 / 3.0 + 1e-5).sqrt() * 1.5 + 0.25);
    let mut map = Array2::zeros((SIDE, SIDE));
    for c in 0..3 {
        let even = w[token + c] * colour(c).mean().unwrap();
        map = map + &colour(c) * (kernel[c] + w[patch + c]) + even;
    }
    map
}

/// Opsets, and whether the token is first.
const VARIANTS: [(i64, bool); 4] = [(13, false), (16, true), (17, false), (18, true)];

#[test]
fn dpts_operators_run_in_tract() {
    let folder = tempfile::tempdir().unwrap();
    for (opset, token_first) in VARIANTS {
        let path = saved(folder.path(), &dpt_like(opset, token_first));
        assert_close(&predicted(&path).unwrap(), &dpt_like_map(token_first), 1e-5);
    }
}

#[test]
#[cfg(feature = "onnxruntime")]
#[ignore = "needs ONNX Runtime's library"]
fn onnxruntime_agrees_with_tract_on_dpts_operators() {
    let folder = tempfile::tempdir().unwrap();
    for (opset, token_first) in VARIANTS {
        let path = saved(folder.path(), &dpt_like(opset, token_first));
        crate::profiles::onnxruntime::agree(&path, &spec(), &pattern(SIDE, SIDE));
    }
}

/// Weights, tensors and ports of 16 bits: widened, the network predicts what one of 32 bits does.
#[test]
fn sixteen_bits_are_widened() {
    let folder = tempfile::tempdir().unwrap();
    let narrow = |weight: &mut TensorProto| {
        if weight.data_type == DataType::Float as i32 {
            let values = weight.raw_data.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
            weight.raw_data = values.flat_map(|v| f16::from_f32(v).to_le_bytes()).collect();
            weight.data_type = DataType::Float16 as i32;
        }
    };
    let mut model = dpt_like(17, false);
    let graph = model.graph.as_mut().unwrap();
    graph.initializer.iter_mut().for_each(narrow);
    for port in graph.input.iter_mut().chain(&mut graph.output) {
        let Value::TensorType(tensor) = port.r#type.as_mut().unwrap().value.as_mut().unwrap();
        tensor.elem_type = DataType::Float16 as i32;
    }
    let path = saved(folder.path(), &model);
    assert_close(&predicted(&path).unwrap(), &dpt_like_map(false), 1e-5);
    let bytes = OnnxPrior::open(&path, &spec()).unwrap().memory(SIDE, SIDE).unwrap().model;
    assert!(bytes > 2 * std::fs::metadata(&path).unwrap().len(), "{bytes}");
}

/// Sizes and attributes that took all memory, time or the process.
#[test]
fn what_no_machine_can_compute_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let convolution = |pads: i64| {
        let node = node("Conv", &["image", "k"], "depth", &[("pads", &[pads; 4])]);
        network(17, vec![node], vec![floats("k", &[1, 3, 1, 1], &[1.0; 3])])
    };
    let transposed = vec![node("Transpose", &["image"], "depth", &[("perm", &[0, 1, 2, 2])])];
    let filled = vec![
        node("ConstantOfShape", &["sides"], "filled", &[]),
        node("ReduceMax", &["filled"], "most", &[("keepdims", &[0])]),
        node("Mul", &["image", "most"], "depth", &[]),
    ];
    let name = |at: usize| if at == 5000 { "depth".to_owned() } else { format!("r{at}") };
    let mut chain = vec![node("Relu", &["image"], "r0", &[])];
    chain.extend((0..5000).map(|at| node("Relu", &[&name(at)], &name(at + 1), &[])));
    let cases = [
        (convolution(8000), "check its pads"),
        (convolution(1 << 14), "a tensor of 4 GiB"),
        (convolution(1 << 20), "GiB"),
        (convolution(1 << 31), "pads is 2147483648"),
        (convolution(i64::MAX), "pads is"),
        (network(17, transposed, vec![]), "perm is"),
        (network(17, filled, vec![integers("sides", &[1 << 11, 1 << 20])]), "filled computes a tensor"),
        (network(17, chain, vec![]), "a chain of"),
    ];
    for (model, reason) in cases {
        let start = Instant::now();
        let message = predicted(&saved(folder.path(), &model)).unwrap_err().to_string();
        assert!(message.contains(reason) && message.contains("; "), "{message}");
        assert!(start.elapsed() < Duration::from_secs(5), "{message}: {:?}", start.elapsed());
    }
}

/// One attribute, side, name or operator of a network is another one.
fn mutate(graph: &mut GraphProto, mut draw: impl FnMut(usize) -> usize) {
    const VALUES: [i64; 12] = [0, -1, 1, 2, 5, 255, 1 << 14, 1 << 20, 1 << 31, 1 << 40, i64::MAX, i64::MIN];
    let value = VALUES[draw(VALUES.len())];
    let (at, other) = (draw(graph.node.len()), draw(graph.node.len()));
    let taken = (graph.node[other].op_type.clone(), graph.node[other].output[0].clone());
    match draw(6) {
        0 if !graph.initializer.is_empty() => {
            let count = graph.initializer.len();
            let weight = &mut graph.initializer[draw(count)];
            match draw(3) {
                0 => weight.raw_data.truncate(3),
                1 if weight.data_type == DataType::Int64 as i32 && weight.raw_data.len() >= 8 => {
                    weight.raw_data[..8].copy_from_slice(&value.to_le_bytes());
                }
                _ => weight.dims.iter_mut().take(1).for_each(|side| *side = value),
            }
        }
        1 => graph.node[at].op_type = taken.0,
        2 => graph.node[at].input.iter_mut().take(1).for_each(|name| name.clone_from(&taken.1)),
        3 => drop(graph.node.remove(at)),
        4 => drop(graph.node[at].input.pop()),
        _ => {
            let attributes: Vec<_> = graph.node.iter_mut().flat_map(|node| &mut node.attribute).collect();
            let count = attributes.len().max(1);
            let chosen = draw(count);
            for attribute in attributes.into_iter().skip(chosen).take(1) {
                attribute.i = value;
                attribute.ints.iter_mut().take(1 + chosen % 4).for_each(|v| *v = value);
            }
        }
    }
}

#[test]
fn mutated_networks_give_a_map_or_an_error_within_seconds() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name| tract_onnx::onnx().proto_model_for_path(fixture(name)).unwrap();
    let mut models =
        ["midas_dynamic.onnx", "convolutions.onnx", "moge2.onnx", "enlarged.onnx"].map(read).to_vec();
    models.extend([dpt_like(13, false), dpt_like(17, true)]);
    let mut state = 1_u64;
    let mut refused = 0;
    for case in 0..300 {
        let mut draw = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below
        };
        let mut model = models[case % models.len()].clone();
        mutate(model.graph.as_mut().unwrap(), &mut draw);
        let start = Instant::now();
        let result = predicted(&saved(folder.path(), &model));
        assert!(start.elapsed() < Duration::from_secs(20), "{case}: {result:?} {:?}", start.elapsed());
        refused += usize::from(result.is_err());
    }
    assert!((100..300).contains(&refused), "{refused}");
}
