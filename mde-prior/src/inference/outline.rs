//! What a graph shows of its network before it is loaded.

use super::runtime::{attribute, proto, stated_sides};
use crate::prior::{FIELDS_OF_VIEW, INVERSE_DEPTHS};
use crate::{Error, Result};
use std::path::Path;
use tract_onnx::pb::tensor_shape_proto::dimension::Value;
use tract_onnx::pb::{NodeProto, ValueInfoProto};

/// The layers by which FastDepth (Wofk et al., 2019) is recognised: MobileNet's depthwise convolutions of 3 x 3, and those of 5 x 5 of its decoder.
const FASTDEPTH: (usize, usize) = (13, 5);
/// Its input.
const FASTDEPTH_INPUT: [i64; 4] = [1, 3, 224, 224];

#[derive(Debug, Default)]
pub(super) struct Outline {
    /// Names of the outputs.
    pub(super) outputs: Vec<String>,
    /// Sides of the only input, where they are fixed.
    input: Vec<i64>,
    /// Convolutions as in [`FASTDEPTH`], of a network that has no matrix products, so no attention.
    layers: Option<(usize, usize)>,
}

impl Outline {
    /// Of the graph in a file.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let graph = proto(path)?.graph;
        let graph = graph.ok_or_else(|| Error::malformed(path, "the file has no graph; copy it again"))?;
        // Older exports name their weights among the inputs.
        let is_weight = |port: &&ValueInfoProto| graph.initializer.iter().any(|w| w.name == port.name);
        let inputs: Vec<_> = graph.input.iter().filter(|port| !is_weight(port)).collect();
        let input = match inputs.as_slice() {
            [one] => fixed(one),
            _ => Vec::new(),
        };
        let outputs = graph.output.iter().map(|port| port.name.clone()).collect();
        let attends = graph.node.iter().any(|node| matches!(node.op_type.as_str(), "MatMul" | "Gemm"));
        let convolutions = || graph.node.iter().filter(|node| node.op_type == "Conv");
        let grouped = |node: &NodeProto| attribute(node, "group").is_some_and(|group| group.i > 1);
        let depthwise = |node: &&NodeProto| kernel(node) == [3, 3] && grouped(node);
        let layers = (!attends).then(|| {
            let decoder = convolutions().filter(|node| kernel(node) == [5, 5]);
            (convolutions().filter(depthwise).count(), decoder.count())
        });
        Ok(Self { outputs, input, layers })
    }

    /// The profile of a network that cannot be mistaken.
    pub(super) fn profile(&self) -> Option<&'static str> {
        let has = |name: &str| self.outputs.iter().any(|output| output == name);
        let all = |names: &[&str]| names.iter().all(|name| has(name));
        let any = |names: &[&str]| names.iter().any(|name| has(name));
        if all(&["points", "mask", "metric_scale"]) {
            Some("moge-2")
        } else if all(&["pts_3d", "intrinsics"]) || all(&["out_K", "depth", "confidence"]) {
            Some("unidepth-v2")
        } else if all(&["predicted_depth", "focallength_px"]) || any(&FIELDS_OF_VIEW) && any(&INVERSE_DEPTHS)
        {
            Some("depth-pro")
        } else if all(&["predicted_depth", "predicted_normal", "normal_confidence"]) {
            Some("metric3d-v2")
        } else if self.input == FASTDEPTH_INPUT && self.outputs.len() == 1 && self.layers == Some(FASTDEPTH) {
            Some("fastdepth")
        } else {
            None
        }
    }
}

/// The sides of a tensor; none where one is not fixed.
fn fixed(port: &ValueInfoProto) -> Vec<i64> {
    let sides = stated_sides(port).into_iter().flatten().map(|side| match side.value {
        Some(Value::DimValue(side)) => Some(side),
        _ => None,
    });
    sides.collect::<Option<_>>().unwrap_or_default()
}

fn kernel(node: &NodeProto) -> &[i64] {
    attribute(node, "kernel_shape").map_or(&[], |sides| &sides.ints)
}
