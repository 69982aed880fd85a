//! A network as a graph, whatever runs it.

use crate::InferenceMemory;
use crate::spec::Layout;

/// An input or output of a graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Port {
    pub(super) name: String,
    /// Sides of the tensor, `None` where they are not fixed; nothing where not even their number is.
    pub(super) sides: Option<Vec<Option<usize>>>,
    /// Element type where it is not a 32-bit float.
    pub(super) other_type: Option<String>,
}

/// An output tensor.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Output {
    pub(super) shape: Vec<usize>,
    pub(super) values: Vec<f32>,
}

/// A network that a runtime has loaded. Inputs other than the image are whole numbers, which are given when it is opened.
pub(super) trait Graph: Send + Sync {
    /// Its inputs and outputs.
    fn ports(&self) -> (&[Port], &[Port]);

    /// The `outputs`, by their indices, of an image of that shape. An error is one line without the file's name.
    fn run(&self, shape: [usize; 4], values: Vec<f32>, outputs: &[usize]) -> Result<Vec<Output>, String>;

    /// Memory for an image of that shape and those outputs; of the network itself, what comes beside its weights.
    fn memory(&self, shape: [usize; 4], outputs: &[usize]) -> Result<InferenceMemory, String>;

    /// Predictions that are worth running at once.
    fn concurrency(&self) -> usize;
}

/// Index of the image among the inputs; an error for inputs that are neither an image nor numbers that `tokens` gives.
pub(super) fn image_input(inputs: &[Port], tokens: Option<u32>) -> Result<usize, String> {
    let is_number = |port: &Port| port.other_type.as_ref().is_some_and(|kind| kind.contains("64"));
    let image = match tokens {
        Some(_) => inputs.iter().position(|port| !is_number(port)),
        None => (!inputs.is_empty()).then_some(0),
    };
    let others = inputs.len() - usize::from(image.is_some());
    match (image, tokens) {
        (Some(image), None) if others == 0 => Ok(image),
        (Some(image), Some(_)) if inputs.iter().filter(|port| is_number(port)).count() == others => Ok(image),
        _ => {
            let names: Vec<&str> = inputs.iter().map(|port| port.name.as_str()).collect();
            Err(format!(
                "the model has the inputs {}; give one with an image, and tokens for a number",
                names.join(", ")
            ))
        }
    }
}

/// Height and width where the image has them fixed; an error when it is no image of three channels.
pub(super) fn fixed_size(input: &Port, layout: Layout) -> Result<(Option<usize>, Option<usize>), String> {
    if let Some(kind) = &input.other_type {
        return Err(format!("the input is {kind}; export the model with float32 input"));
    }
    let Some(sides) = &input.sides else { return Ok((None, None)) };
    let &[batch, a, b, c] = sides.as_slice() else {
        return Err(format!("the input has {} axes; export it with 4, [1, 3, height, width]", sides.len()));
    };
    let (axis, channels, height, width) = match layout {
        Layout::Nchw => (1, a, b, c),
        Layout::Nhwc => (3, c, a, b),
    };
    match (batch, channels) {
        (Some(batch), _) if batch != 1 => {
            Err(format!("the input takes {batch} images at once; export it for 1"))
        }
        (_, Some(channels)) if channels != 3 => {
            Err(format!("axis {axis} of the input has {channels} channels, not 3; check layout"))
        }
        _ => Ok((height, width)),
    }
}
