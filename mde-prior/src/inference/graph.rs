//! A network as a graph, whatever runs it.

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

/// A network that a runtime has loaded.
pub(super) trait Graph: Send + Sync {
    fn inputs(&self) -> &[Port];

    fn outputs(&self) -> &[Port];

    /// The output with that index for one image, `values` in the order of `shape`. An error is one line without the file's name.
    fn run(&self, shape: [usize; 4], values: Vec<f32>, output: usize) -> Result<Output, String>;

    /// Predictions that are worth running at once.
    fn concurrency(&self) -> usize;
}

/// Height and width where the input has them fixed; an error when the graph does not take one image of three channels.
pub(super) fn fixed_size(
    graph: &dyn Graph,
    layout: Layout,
) -> Result<(Option<usize>, Option<usize>), String> {
    let [input] = graph.inputs() else {
        return Err(format!(
            "the model has {} inputs; give a model with one, an image",
            graph.inputs().len()
        ));
    };
    if graph.outputs().is_empty() {
        return Err("the model has no output; export it again".to_owned());
    }
    if let Some(kind) = &input.other_type {
        return Err(format!("the input is {kind}; export the model with float32 input"));
    }
    let Some(sides) = &input.sides else { return Ok((None, None)) };
    let &[batch, ..] = sides.as_slice() else { return Ok((None, None)) };
    if sides.len() != 4 {
        return Err(format!("the input has {} axes; export it with 4, [1, 3, height, width]", sides.len()));
    }
    let (channel, height, width) = match layout {
        Layout::Nchw => (1, 2, 3),
        Layout::Nhwc => (3, 1, 2),
    };
    match (batch, sides[channel]) {
        (Some(batch), _) if batch != 1 => {
            Err(format!("the input takes {batch} images at once; export it for 1"))
        }
        (_, Some(channels)) if channels != 3 => {
            Err(format!("axis {channel} of the input has {channels} channels, not 3; check layout"))
        }
        _ => Ok((sides[height], sides[width])),
    }
}
