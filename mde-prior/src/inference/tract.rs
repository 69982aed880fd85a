//! Networks run by tract, which is part of the program.

use super::graph::{Graph, Output, Port, image_input};
use super::guard::{check_graph, check_shapes, check_tensors, name, place};
use super::onnx::COPIES;
use super::rewrite::rewrite;
use super::runtime::{one_line, shortened};
use crate::InferenceMemory;
use pulp::{Arch, Simd, WithSimd};
use std::cell::Cell;
use std::hint::black_box;
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use tract_linalg::multithread::{Executor, multithread_tract_scope};
use tract_onnx::prelude::*;
use tract_onnx::tract_core::ops::konst::Const as Constant;
use tract_onnx::tract_hir::infer::Factoid as _;
use tract_onnx::tract_hir::internal::DimLike as _;
use tract_onnx::tract_hir::ops::konst::Const;

/// Plans that are kept: each has a copy of the weights. Crops of one image need one or two input sizes.
const KEPT_PLANS: usize = 2;

type Plan = Arc<TypedRunnableModel>;

/// The graph is optimised for each input shape, since graphs that compute sizes from symbolic shapes do not run.
pub(super) struct TractGraph {
    model: InferenceModel,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    /// The name of each node with its operator, as it is shown.
    places: Vec<(String, String)>,
    /// Bytes that its weights have more here than in the file.
    grown: u64,
    /// The latest plans, by input shape and outputs, with the bytes of their tensors.
    plans: Mutex<Vec<(PlanKey, Plan, u64)>>,
}

type PlanKey = ([usize; 4], Vec<usize>);

impl TractGraph {
    /// The graph with `tokens` for its inputs other than the image.
    pub(super) fn open(path: &Path, tokens: Option<u32>) -> Result<Self, String> {
        let cannot =
            |e: TractError| format!("the ONNX model cannot be run ({}); export it again", one_line(&e));
        let reader = tract_onnx::onnx().with_ignore_output_shapes(true).with_ignore_value_info(true);
        let mut file = reader.proto_model_for_path(path).map_err(cannot)?;
        file.graph.as_ref().map_or(Ok(()), check_graph)?;
        let nodes = file.graph.iter().flat_map(|graph| &graph.node);
        let places = nodes.map(|node| (name(node).to_owned(), place(node))).collect();
        let folder = path.parent().and_then(Path::to_str);
        let grown = rewrite(&mut file, folder).map_err(cannot)?;
        let read = reader.parse(&file, folder).map_err(cannot)?;
        drop(file);
        if !read.unresolved_inputs.is_empty() {
            let names = shortened(&read.unresolved_inputs.join(", "));
            return Err(format!("the ONNX model has no {names}; export it again"));
        }
        let mut model = read.model;
        let ports = |outlets: &[OutletId]| outlets.iter().map(|outlet| port(&model, *outlet)).collect();
        let inputs: Vec<Port> = ports(model.input_outlets().map_err(cannot)?);
        let outputs = ports(model.output_outlets().map_err(cannot)?);
        if let Some(tokens) = tokens {
            let image = image_input(&inputs, Some(tokens))?;
            constant(&mut model, image, &inputs, tokens).map_err(cannot)?;
        }
        Ok(Self { model, inputs, outputs, places, grown, plans: Mutex::default() })
    }

    fn plan(&self, shape: [usize; 4], outputs: &[usize]) -> Result<(Plan, u64), String> {
        // A plan is stored whole, so it is valid even if another thread panicked.
        let mut plans = self.plans.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = plans.iter().find(|((size, wanted), ..)| *size == shape && wanted == outputs);
        if let Some((_, plan, bytes)) = kept {
            return Ok((Arc::clone(plan), *bytes));
        }
        let refused = |e: TractError| {
            let (culprit, reason) = (self.culprit(&e), one_line(&e));
            format!(
                "the model takes no input of {shape:?}{culprit} ({reason}); check its input size, or try ONNX Runtime"
            )
        };
        let mut model = self.model.clone();
        if self.outputs.len() > 1 {
            // What the other outputs alone need is not computed.
            let all = model.output_outlets().map_err(refused)?.to_vec();
            let wanted: Vec<OutletId> = outputs.iter().filter_map(|index| all.get(*index).copied()).collect();
            model.select_output_outlets(&wanted).map_err(refused)?;
        }
        let fact = InferenceFact::from(f32::fact(shape));
        let model = model.with_input_fact(0, fact).map_err(refused)?;
        check_shapes(model.clone())?;
        let model = model.into_optimized().map_err(refused)?;
        check_tensors(&model)?;
        let bytes = tensor_bytes(&model).map_err(refused)?;
        let plan = model.into_runnable().map_err(refused)?;
        if plans.len() == KEPT_PLANS {
            plans.remove(0);
        }
        plans.push(((shape, outputs.to_vec()), Arc::clone(&plan), bytes));
        Ok((plan, bytes))
    }

    /// The operator that an error of tract names, which has parts of operators too.
    fn culprit(&self, error: &TractError) -> String {
        let text = format!("{error:#}");
        let named = self.places.iter().filter(|(name, _)| text.contains(&format!("\"{name}")));
        let longest = named.max_by_key(|(name, _)| name.len());
        longest.map_or_else(String::new, |(_, place)| format!(": {place} fails"))
    }
}

impl Graph for TractGraph {
    fn ports(&self) -> (&[Port], &[Port]) {
        (&self.inputs, &self.outputs)
    }

    fn run(&self, shape: [usize; 4], values: Vec<f32>, outputs: &[usize]) -> Result<Vec<Output>, String> {
        let (plan, _) = self.plan(shape, outputs)?;
        let compute = || {
            let input = Tensor::from_shape(&shape, &values).map_err(|e| one_line(&e))?;
            let outputs = plan.run(tvec!(input.into()));
            Arch::new().dispatch(ClearRegisters);
            let outputs = outputs.map_err(|e| {
                let reason = one_line(&e);
                format!("the model fails at {shape:?} ({reason}); check its input size, or try ONNX Runtime")
            })?;
            outputs.iter().map(|output| floats(output).map_err(|e| one_line(&e))).collect()
        };
        if WITHIN.replace(true) {
            return on_own_thread(compute);
        }
        let _within = Within;
        // The pool that this runs in: threads without a prediction of their own help. Work is split between outputs, never within
        // a sum, so the bytes stay the same.
        multithread_tract_scope(Executor::RayonGlobal, compute)
    }

    fn memory(&self, shape: [usize; 4], outputs: &[usize]) -> Result<InferenceMemory, String> {
        Ok(InferenceMemory {
            model: COPIES.saturating_mul(self.grown),
            prediction: self.plan(shape, outputs)?.1,
        })
    }

    fn concurrency(&self) -> usize {
        usize::MAX
    }
}

thread_local! {
    static WITHIN: Cell<bool> = const { Cell::new(false) };
}

/// This thread is within a prediction. While it waits there for its part of a matrix product, rayon gives it whatever the pool has to do,
/// another prediction too; tract's scratch of that thread is borrowed meanwhile, and borrowing it again panics.
struct Within;

impl Drop for Within {
    fn drop(&mut self) {
        WITHIN.set(false);
    }
}

/// Runs a prediction on a thread of its own, which has a scratch of its own, and waits for it.
fn on_own_thread<T: Send>(predict: impl FnOnce() -> Result<T, String> + Send) -> Result<T, String> {
    std::thread::scope(|scope| match std::thread::Builder::new().spawn_scoped(scope, predict) {
        Ok(thread) => thread.join().unwrap_or_else(|panic| resume_unwind(panic)),
        Err(e) => Err(format!("the system gives no further thread ({e}); give fewer --threads")),
    })
}

/// Clears the upper halves of the vector registers: tract's matrix kernels end without `vzeroupper`, and then each change between
/// SSE code, such as ours, and AVX code, such as libm's logarithm, takes some hundred cycles. The compiler ends AVX code with it.
struct ClearRegisters;

impl WithSimd for ClearRegisters {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        black_box(simd.splat_f32s(black_box(1.0)));
    }
}

/// The most that the tensors of a plan take at once, its constants apart.
fn tensor_bytes(model: &TypedModel) -> TractResult<u64> {
    let order = model.eval_order()?;
    let alive = model.eval_tmp_memory_usage(&order, |node| !node.op_is::<Constant>())?;
    let most = alive.iter().filter_map(|(_, bytes)| bytes.to_i64().ok()).max();
    Ok(most.unwrap_or(0).unsigned_abs())
}

fn floats(output: &Tensor) -> TractResult<Output> {
    let shape = output.shape().to_vec();
    let output = output.cast_to::<f32>()?;
    let values = output.to_plain_array_view::<f32>()?;
    Ok(Output { shape, values: values.iter().copied().collect() })
}

/// Puts a constant in the place of every input but the image.
fn constant(model: &mut InferenceModel, image: usize, inputs: &[Port], value: u32) -> TractResult<()> {
    let outlets = model.input_outlets()?.to_vec();
    for (index, outlet) in outlets.iter().enumerate().filter(|(index, _)| *index != image) {
        let axes = inputs.get(index).and_then(|port| port.sides.as_ref()).map_or(0, Vec::len);
        let number = Tensor::from_shape(&vec![1; axes], &[i64::from(value)])?.into_arc_tensor();
        model.set_outlet_fact(*outlet, InferenceFact::dt_shape(i64::datum_type(), number.shape()))?;
        model.node_mut(outlet.node).op = Box::new(Const::new(number)?);
    }
    model.set_input_outlets(&outlets[image..=image])
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
