//! Refusal of graphs that would take too much memory or time, before anything is computed or optimised.

use std::collections::{HashMap, HashSet};

use tract_onnx::pb::{GraphProto, NodeProto};
use tract_onnx::prelude::*;
use tract_onnx::tract_hir::infer::Factoid as _;
use tract_onnx::tract_hir::internal::DimLike as _;

use super::runtime::{inner_graphs, shortened};

/// Bytes of the largest tensor that a network may compute, and of one that is computed before there is an image.
const MAX_TENSOR: usize = 1 << 32;
const MAX_CONSTANT: usize = 1 << 30;
/// Places of a kernel: a convolution is planned with a table of them.
const MAX_PLACES: usize = 1 << 27;
/// The largest side, step or border of a kernel.
const MAX_SIDE: i64 = 1 << 20;
/// Operators of one input each in a row. tract compares each node that its optimiser adds with every node there is (`ModelPatch::apply`):
/// 2,000 take some 10 s, 4,000 a minute.
const MAX_CHAIN: usize = 4000;

/// Attributes that are lengths.
const LENGTHS: [&str; 7] =
    ["pads", "strides", "dilations", "kernel_shape", "output_padding", "output_shape", "blocksize"];

/// Refuses attributes that are out of any range, and chains of thousands of operators.
pub(super) fn check_graph(graph: &GraphProto) -> Result<(), String> {
    let mut constants: HashSet<&str> = graph.initializer.iter().map(|weight| weight.name.as_str()).collect();
    let mut chains = HashMap::new();
    for node in &graph.node {
        check_attributes(node)?;
        if node.input.is_empty() {
            constants.extend(node.output.iter().map(String::as_str));
        }
        let computed = |name: &&String| !name.is_empty() && !constants.contains(name.as_str());
        let mut inputs = node.input.iter().filter(computed);
        let chain = match (inputs.next(), inputs.next()) {
            (Some(one), None) => 1 + chains.get(one.as_str()).copied().unwrap_or(0),
            _ => 0,
        };
        if chain > MAX_CHAIN {
            return Err(format!("{} ends a chain of {chain} operators; check the model", place(node)));
        }
        chains.extend(node.output.iter().map(|name| (name.as_str(), chain)));
        inner_graphs(node).try_for_each(check_graph)?;
    }
    Ok(())
}

fn check_attributes(node: &NodeProto) -> Result<(), String> {
    for attribute in &node.attribute {
        let refused = |what: String| {
            Err(format!("{}: {} is {what}; check the model", place(node), shortened(&attribute.name)))
        };
        if LENGTHS.contains(&attribute.name.as_str()) {
            let lengths = attribute.ints.iter().chain([&attribute.i]);
            if let Some(length) = lengths.copied().find(|length| *length > MAX_SIDE) {
                return refused(length.to_string());
            }
        }
        if attribute.name == "perm" {
            let mut axes = attribute.ints.clone();
            axes.sort_unstable();
            if !axes.iter().copied().eq(0..axes.len() as i64) {
                return refused(shortened(&format!("{:?}, no order of axes", attribute.ints)));
            }
        }
    }
    Ok(())
}

/// The name of a node, as tract has it.
pub(super) fn name(node: &NodeProto) -> &str {
    let name = Some(&node.name).filter(|name| !name.is_empty()).or(node.output.first());
    name.map_or("", String::as_str)
}

/// Operator and name.
pub(super) fn place(node: &NodeProto) -> String {
    format!("{} {:?}", shortened(&node.op_type), shortened(name(node)))
}

/// Refuses a network with a tensor that no machine for it holds, before the first is computed. Shapes are inferred in the graph's order;
/// what cannot be inferred is left to [`check_tensors`].
pub(super) fn check_shapes(mut model: InferenceModel) -> Result<(), String> {
    for id in model.eval_order().unwrap_or_default() {
        let node = model.node(id);
        let (mut op, name) = (node.op.clone(), node.name.clone());
        let slides = ["ConvHir", "ConvTranspose", "MaxPool", "SumPool"].contains(&&*op.name());
        let outlets: Vec<OutletId> =
            (0..node.outputs.len()).map(|slot| OutletId::new(id, slot)).chain(node.inputs.clone()).collect();
        let Ok((inputs, outputs)) = model.node_facts(id) else { continue };
        let (inputs, outputs): (TVec<_>, TVec<_>) =
            (inputs.into_iter().cloned().collect(), outputs.into_iter().cloned().collect());
        let Ok(observed) = op.observe_outlets(&model, model.node(id)) else { continue };
        if !observed.is_empty() {
            continue;
        }
        let constant = !inputs.is_empty() && inputs.iter().all(|input| input.value.is_concrete());
        let shapes = op.infer_facts(inputs.iter().collect(), outputs.iter().collect(), tvec!());
        let Ok((_, found, _)) = shapes else { continue };
        for fact in &found {
            let kind = fact.datum_type.concretize().unwrap_or(f32::datum_type());
            let sides = fact.shape.dims().filter_map(|side| side.concretize()?.to_i64().ok());
            let sides: Vec<usize> = sides.filter_map(|side| usize::try_from(side).ok()).collect();
            check_size(&name, &sides, kind, if constant { MAX_CONSTANT } else { MAX_TENSOR })?;
            let places = sides.iter().skip(2).copied().fold(1_usize, usize::saturating_mul);
            if slides && places > MAX_PLACES {
                return Err(format!("{} has a kernel at {places} places; check its pads", shortened(&name)));
            }
        }
        let values = op.infer(inputs.iter().collect(), outputs.iter().collect(), tvec!());
        let Ok((inputs, outputs, _)) = values else { continue };
        for (outlet, fact) in outlets.into_iter().zip(outputs.iter().chain(&inputs)) {
            let known = model.outlet_fact(outlet).and_then(|known| known.unify(fact));
            let _ = known.and_then(|fact| model.set_outlet_fact(outlet, fact));
        }
    }
    Ok(())
}

/// The same of a network that is optimised, before a tensor is allocated.
pub(super) fn check_tensors(model: &TypedModel) -> Result<(), String> {
    for node in model.nodes() {
        for output in &node.outputs {
            let sides: Vec<usize> =
                output.fact.shape.iter().filter_map(|side| side.to_usize().ok()).collect();
            check_size(&node.name, &sides, output.fact.datum_type, MAX_TENSOR)?;
        }
    }
    Ok(())
}

fn check_size(name: &str, sides: &[usize], kind: DatumType, most: usize) -> Result<(), String> {
    let bytes = sides.iter().copied().fold(kind.size_of(), usize::saturating_mul);
    if bytes <= most {
        return Ok(());
    }
    Err(format!(
        "{} computes a tensor of {} GiB; check the model and its input size",
        shortened(name),
        bytes >> 30
    ))
}
