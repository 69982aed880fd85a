//! A graph as tract runs it: other nodes of the same value for those that it refuses, and 32-bit floats for the slow ones of 16 bits.

use std::collections::{HashMap, HashSet};

use tract_onnx::data_resolver::MmapDataResolver;
use tract_onnx::pb::attribute_proto::AttributeType;
use tract_onnx::pb::tensor_proto::DataType;
use tract_onnx::pb::type_proto::Value;
use tract_onnx::pb::{AttributeProto, GraphProto, ModelProto, NodeProto, TensorProto, ValueInfoProto};
use tract_onnx::prelude::*;
use tract_onnx::tensor::load_tensor;

use super::runtime::{attribute, inner_graphs, stated_sides};

const FLOAT: i32 = DataType::Float as i32;
const FLOAT16: i32 = DataType::Float16 as i32;

/// Rewrites a model whose further weights are in `folder`; returns the bytes that its weights grow by.
pub(super) fn rewrite(model: &mut ModelProto, folder: Option<&str>) -> TractResult<u64> {
    let standard = |domain: &str| domain.is_empty() || domain == "ai.onnx";
    let opset = model.opset_import.iter().find(|set| standard(&set.domain)).map_or(0, |set| set.version);
    let Some(graph) = &mut model.graph else { return Ok(0) };
    let grown = widen(graph, folder)?;
    replace(graph, opset);
    Ok(grown)
}

/// 32-bit floats for those of 16 bits, in a graph and in those within it; returns the bytes that it grows by.
fn widen(graph: &mut GraphProto, folder: Option<&str>) -> TractResult<u64> {
    let ports = graph.input.iter_mut().chain(&mut graph.output).chain(&mut graph.value_info);
    for kind in ports.filter_map(|port| port.r#type.as_mut()?.value.as_mut()) {
        let Value::TensorType(tensor) = kind;
        if tensor.elem_type == FLOAT16 {
            tensor.elem_type = FLOAT;
        }
    }
    let mut grown = 0;
    for tensor in &mut graph.initializer {
        grown += widen_tensor(tensor, folder)?;
    }
    for attribute in graph.node.iter_mut().flat_map(|node| &mut node.attribute) {
        if matches!(attribute.name.as_str(), "to" | "dtype") && attribute.i == i64::from(FLOAT16) {
            attribute.i = i64::from(FLOAT);
        }
        for tensor in attribute.t.iter_mut().chain(&mut attribute.tensors) {
            grown += widen_tensor(tensor, folder)?;
        }
        for inner in attribute.g.iter_mut().chain(&mut attribute.graphs) {
            grown += widen(inner, folder)?;
        }
    }
    Ok(grown)
}

fn widen_tensor(tensor: &mut TensorProto, folder: Option<&str>) -> TractResult<u64> {
    if tensor.data_type != FLOAT16 {
        return Ok(0);
    }
    let values = load_tensor(&MmapDataResolver, tensor, folder)?.cast_to::<f32>()?.into_owned();
    let raw_data = values.as_bytes().to_vec();
    let grown = raw_data.len() as u64 / 2;
    let (name, dims) = (std::mem::take(&mut tensor.name), std::mem::take(&mut tensor.dims));
    *tensor = TensorProto { name, dims, data_type: FLOAT, raw_data, ..TensorProto::default() };
    Ok(grown)
}

/// Replaces the nodes that tract refuses.
fn replace(graph: &mut GraphProto, opset: i64) {
    let mut read: HashSet<String> = graph.output.iter().map(|output| output.name.clone()).collect();
    names_read(graph, &mut read);
    let nodes = std::mem::take(&mut graph.node);
    let by_output: HashMap<String, NodeProto> = nodes
        .iter()
        .filter(|node| matches!(node.op_type.as_str(), "Concat" | "Expand"))
        .flat_map(|node| node.output.iter().map(|name| (name.clone(), node.clone())))
        .collect();
    for mut node in nodes {
        if node.op_type == "BatchNormalization" {
            while node.output.len() > 1 && node.output.last().is_some_and(|name| !read.contains(name)) {
                node.output.pop();
            }
        }
        let mut steps = Steps { output: node.output.first().cloned().unwrap_or_default(), graph };
        let done = match node.op_type.as_str() {
            "MatMul" if opset >= 10 => product_of_parts(&node, &by_output, &mut steps),
            "BatchNormalization" => training_statistics(&node, opset, &mut steps),
            _ => None,
        };
        if done.is_none() {
            graph.node.push(node);
        }
    }
}

/// The names that a graph's nodes read, those in the graphs within them too.
fn names_read(graph: &GraphProto, names: &mut HashSet<String>) {
    for node in &graph.node {
        names.extend(node.input.iter().cloned());
        for inner in inner_graphs(node) {
            names.extend(inner.output.iter().map(|output| output.name.clone()));
            names_read(inner, names);
        }
    }
}

/// `MatMul(Concat([a, Expand(b)], -1), w)`, as DPT projects its read-out token beside each patch: `MatMul(a, w[..k]) + MatMul(b, w[k..])`
/// with `k` the last side of `a`, in either order. tract loses the expanded axis.
fn product_of_parts(
    node: &NodeProto,
    by_output: &HashMap<String, NodeProto>,
    steps: &mut Steps<'_>,
) -> Option<()> {
    let [joined, weights] = node.input.as_slice() else { return None };
    let concat = by_output.get(joined).filter(|concat| concat.op_type == "Concat")?;
    let [first, second] = concat.input.as_slice() else { return None };
    let of_concat = |port: &&ValueInfoProto| port.name == *joined || concat.input.contains(&port.name);
    let sides = steps.graph.value_info.iter().filter(of_concat).find_map(stated_sides);
    let rank = sides.map_or(0, <[_]>::len) as i64;
    let last_axis = attribute(concat, "axis").is_some_and(|axis| axis.i == -1 || axis.i == rank - 1);
    let expanded = |name: &String| by_output.get(name).filter(|from| from.op_type == "Expand")?.input.first();
    // The other part has all rows of the product.
    if !last_axis || expanded(first).is_some() == expanded(second).is_some() {
        return None;
    }
    let [start, end, last, rows] =
        [("start", 0), ("end", i64::MAX), ("last", -1), ("rows", -2)].map(|(name, v)| steps.number(name, v));
    let shape = steps.add("Shape", &[first]);
    let k = steps.add("Slice", &[&shape, &last, &end]);
    let upper = steps.add("Slice", &[weights, &start, &k, &rows]);
    let lower = steps.add("Slice", &[weights, &k, &end, &rows]);
    let upper = steps.add("MatMul", &[expanded(first).unwrap_or(first), &upper]);
    let lower = steps.add("MatMul", &[expanded(second).unwrap_or(second), &lower]);
    steps.finish("Add", &[&upper, &lower])
}

/// `BatchNormalization` in training mode, as BiT standardises its weights: `(x - mean) / sqrt(variance + epsilon) * scale + shift` with mean
/// and variance of each channel of `x`.
fn training_statistics(node: &NodeProto, opset: i64, steps: &mut Steps<'_>) -> Option<()> {
    let [x, scale, shift, ..] = node.input.as_slice() else { return None };
    if attribute(node, "training_mode")?.i == 0 || node.output.len() > 1 {
        return None;
    }
    let float_data = vec![attribute(node, "epsilon").map_or(1e-5, |epsilon| epsilon.f)];
    let epsilon = TensorProto { data_type: FLOAT, float_data, ..TensorProto::default() };
    let epsilon = steps.weight("epsilon", epsilon);
    let axis = steps.number("axis", 0);
    let (name, r#type) = ("axes".to_owned(), AttributeType::Ints as i32);
    let axes = AttributeProto { name, r#type, ints: vec![0], ..AttributeProto::default() };
    let mean = |steps: &mut Steps<'_>, of: &str| {
        let each = steps.add("GlobalAveragePool", &[of]);
        match opset {
            ..18 => steps.add_with("ReduceMean", &[&each], vec![axes.clone()]),
            _ => steps.add("ReduceMean", &[&each, &axis]),
        }
    };
    let centre = mean(steps, x);
    let residual = steps.add("Sub", &[x, &centre]);
    let squared = steps.add("Mul", &[&residual, &residual]);
    let variance = mean(steps, &squared);
    let variance = steps.add("Add", &[&variance, &epsilon]);
    let deviation = steps.add("Sqrt", &[&variance]);
    let standard = steps.add("Div", &[&residual, &deviation]);
    let sides = steps.add("Shape", &[&centre]);
    let [scale, shift] = [scale, shift].map(|values| steps.add("Reshape", &[values, &sides]));
    let scaled = steps.add("Mul", &[&standard, &scale]);
    steps.finish("Add", &[&scaled, &shift])
}

/// Writes the nodes that replace one.
struct Steps<'g> {
    graph: &'g mut GraphProto,
    /// The output of the node that is replaced.
    output: String,
}

impl Steps<'_> {
    /// Adds a node and returns the name of its output.
    fn add(&mut self, operator: &str, inputs: &[&str]) -> String {
        self.add_with(operator, inputs, Vec::new())
    }

    fn add_with(&mut self, operator: &str, inputs: &[&str], attribute: Vec<AttributeProto>) -> String {
        let output = format!("{}/{operator}.{}", self.output, self.graph.node.len());
        self.graph.node.push(NodeProto {
            op_type: operator.to_owned(),
            input: inputs.iter().map(|name| (*name).to_owned()).collect(),
            output: vec![output.clone()],
            name: output.clone(),
            attribute,
            ..NodeProto::default()
        });
        output
    }

    /// The last node, whose output is that of the one replaced.
    fn finish(&mut self, operator: &str, inputs: &[&str]) -> Option<()> {
        let output = self.output.clone();
        self.add(operator, inputs);
        self.graph.node.last_mut()?.output = vec![output];
        Some(())
    }

    /// An integer as a vector of one side, and its name.
    fn number(&mut self, name: &str, value: i64) -> String {
        let (data_type, int64_data) = (DataType::Int64 as i32, vec![value]);
        self.weight(name, TensorProto { data_type, dims: vec![1], int64_data, ..TensorProto::default() })
    }

    fn weight(&mut self, name: &str, values: TensorProto) -> String {
        let name = format!("{}/{name}", self.output);
        self.graph.initializer.push(TensorProto { name: name.clone(), ..values });
        name
    }
}
