//! What a graph shows of its network before it is loaded.

use super::runtime::{attribute, proto, stated_sides};
use crate::prior::{FIELDS_OF_VIEW, INVERSE_DEPTHS};
use crate::{Error, Result};
use std::path::Path;
use tract_onnx::pb::tensor_shape_proto::dimension::Value;
use tract_onnx::pb::{AttributeProto, NodeProto, ValueInfoProto};

/// The layers by which FastDepth (Wofk et al., 2019) is recognised: MobileNet's depthwise convolutions of 3 x 3, and those of 5 x 5 of its decoder.
const FASTDEPTH: (usize, usize) = (13, 5);
/// Its input.
const FASTDEPTH_INPUT: [i64; 4] = [1, 3, 224, 224];

#[derive(Debug, Default)]
pub(super) struct Outline {
    /// Names of the outputs.
    pub(super) outputs: Vec<String>,
    /// Whether it has FastDepth's input and layers, and no other input.
    is_fastdepth: bool,
}

impl Outline {
    /// Of the graph in a file.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let graph = proto(path)?.graph;
        let graph = graph.ok_or_else(|| Error::malformed(path, "the file has no graph; copy it again"))?;
        // Older exports name their weights among the inputs.
        let is_weight = |port: &&ValueInfoProto| graph.initializer.iter().any(|w| w.name == port.name);
        let inputs: Vec<_> = graph.input.iter().filter(|port| !is_weight(port)).collect();
        let expected = FASTDEPTH_INPUT.map(|side| Some(Value::DimValue(side)));
        let sides = |port| stated_sides(port).into_iter().flatten().map(|side| &side.value);
        let takes_photograph = matches!(*inputs, [one] if sides(one).eq(&expected));
        let outputs = graph.output.iter().map(|port| port.name.clone()).collect();
        // Matrix products are those of attention, which it has none of.
        let attends = graph.node.iter().any(|node| matches!(node.op_type.as_str(), "MatMul" | "Gemm"));
        let convolutions = |kernel: [i64; 2]| {
            let has_kernel = move |sides: &AttributeProto| sides.ints == kernel;
            let convolutions = graph.node.iter().filter(|node| node.op_type == "Conv");
            convolutions.filter(move |node| attribute(node, "kernel_shape").is_some_and(has_kernel))
        };
        let is_grouped = |node: &&NodeProto| attribute(node, "group").is_some_and(|group| group.i > 1);
        let layers = (convolutions([3, 3]).filter(is_grouped).count(), convolutions([5, 5]).count());
        Ok(Self { outputs, is_fastdepth: takes_photograph && !attends && layers == FASTDEPTH })
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
        } else if self.is_fastdepth && self.outputs.len() == 1 {
            Some("fastdepth")
        } else {
            None
        }
    }
}
