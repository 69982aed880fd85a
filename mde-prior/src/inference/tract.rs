//! Networks run by tract, which is part of the program.

use super::graph::{Graph, Output, Port};
use super::runtime::{check_tensors, load, one_line};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use tract_onnx::prelude::*;
use tract_onnx::tract_hir::infer::Factoid as _;
use tract_onnx::tract_hir::internal::DimLike as _;

/// Plans that are kept: each has a copy of the weights. Crops of one image need one or two input sizes.
const KEPT_PLANS: usize = 2;

type Plan = Arc<TypedRunnableModel>;

/// The graph is optimised for each input shape, since graphs that compute sizes from symbolic shapes do not run.
pub(super) struct TractGraph {
    model: InferenceModel,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    /// The latest plans, by input shape and output.
    plans: Mutex<Vec<(([usize; 4], usize), Plan)>>,
}

impl TractGraph {
    /// The graph, and the files of its weights outside the ONNX file.
    pub(super) fn open(path: &Path) -> Result<(Self, Vec<PathBuf>), String> {
        let cannot =
            |e: TractError| format!("the ONNX model cannot be run ({}); export it again", one_line(&e));
        let (model, external) = load(path).map_err(cannot)?;
        let ports = |outlets: &[OutletId]| outlets.iter().map(|outlet| port(&model, *outlet)).collect();
        let inputs = ports(model.input_outlets().map_err(cannot)?);
        let outputs = ports(model.output_outlets().map_err(cannot)?);
        Ok((Self { model, inputs, outputs, plans: Mutex::default() }, external))
    }

    fn plan(&self, shape: [usize; 4], output: usize) -> Result<Plan, String> {
        // A plan is stored whole, so it is valid even if another thread panicked.
        let mut plans = self.plans.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, plan)) = plans.iter().find(|(made_for, _)| *made_for == (shape, output)) {
            return Ok(Arc::clone(plan));
        }
        let refused = |e: TractError| {
            format!("the model takes no input of {shape:?} ({}); check its input size", one_line(&e))
        };
        let mut model = self.model.clone();
        if self.outputs.len() > 1 {
            // What the other outputs alone need is not computed.
            let outlet = model.output_outlets().map_err(refused)?.get(output).copied();
            let outlet =
                outlet.ok_or_else(|| format!("the model has no output {output}; export it again"))?;
            model.select_output_outlets(&[outlet]).map_err(refused)?;
        }
        let fact = InferenceFact::from(f32::fact(shape));
        let model =
            model.with_input_fact(0, fact).and_then(|model| model.into_optimized()).map_err(refused)?;
        check_tensors(&model)?;
        let plan = model.into_runnable().map_err(refused)?;
        if plans.len() == KEPT_PLANS {
            plans.remove(0);
        }
        plans.push(((shape, output), Arc::clone(&plan)));
        Ok(plan)
    }
}

impl Graph for TractGraph {
    fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    fn outputs(&self) -> &[Port] {
        &self.outputs
    }

    fn run(&self, shape: [usize; 4], values: Vec<f32>, output: usize) -> Result<Output, String> {
        let input = Tensor::from_shape(&shape, &values).map_err(|e| one_line(&e))?;
        let outputs = self
            .plan(shape, output)?
            .run(tvec!(input.into()))
            .map_err(|e| format!("the model fails at {shape:?} ({}); check its input size", one_line(&e)))?;
        let output = outputs.first().ok_or_else(|| "the model has no output; export it again".to_owned())?;
        let shape = output.shape().to_vec();
        let output = output.cast_to::<f32>().map_err(|e| one_line(&e))?;
        let values = output.to_plain_array_view::<f32>().map_err(|e| one_line(&e))?;
        Ok(Output { shape, values: values.iter().copied().collect() })
    }

    fn concurrency(&self) -> usize {
        usize::MAX
    }
}

fn port(model: &InferenceModel, outlet: OutletId) -> Port {
    let name = model.outlet_label(outlet).map(str::to_owned);
    let name = name.unwrap_or_else(|| model.node(outlet.node).name.clone());
    let Ok(fact) = model.outlet_fact(outlet) else { return Port { name, sides: None, other_type: None } };
    let side = |axis| fact.shape.dim(axis).and_then(|d| d.concretize()).and_then(|d| d.to_usize().ok());
    let sides = fact.shape.rank().concretize().map(|rank| (0..rank as usize).map(side).collect());
    let other = fact.datum_type.concretize().filter(|kind| *kind != f32::datum_type());
    Port { name, sides, other_type: other.map(|kind| format!("{kind:?}")) }
}
