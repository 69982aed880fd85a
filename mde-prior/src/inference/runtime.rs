//! The edge to the runtime, which panics on some graphs.

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use tract_onnx::pb::tensor_shape_proto::Dimension;
use tract_onnx::pb::type_proto::Value;
use tract_onnx::pb::{AttributeProto, GraphProto, ModelProto, NodeProto, TensorProto, ValueInfoProto};
use tract_onnx::prelude::*;

use crate::{Error, FileKind, Result, open};

/// Calls the runtime; its panic becomes an error that names the file.
pub(super) fn call<T>(path: &Path, work: impl FnOnce() -> Result<T>) -> Result<T> {
    // What is shared is written whole, so it is valid after a panic.
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text =
            panic.downcast_ref::<&str>().copied().or(panic.downcast_ref::<String>().map(String::as_str));
        let text = shortened(text.unwrap_or("a panic"));
        Err(Error::malformed(path, format!("the runtime cannot run this model ({text}); export it again")))
    })
}

/// tract's chain of errors in one line.
pub(super) fn one_line(error: &TractError) -> String {
    shortened(&format!("{error:#}"))
}

pub(super) fn shortened(text: &str) -> String {
    let text = text.split("Stack backtrace").next().unwrap_or_default();
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(240) {
        Some((end, _)) => format!("{} ...", &line[..end]),
        None => line,
    }
}

/// The graph in a file, without the weights that are elsewhere.
pub(super) fn proto(path: &Path) -> Result<ModelProto> {
    open::check(path, FileKind::Network).map_err(|e| Error::read(path, e))?;
    let proto = tract_onnx::onnx().proto_model_for_path(path);
    proto.map_err(|e| {
        Error::malformed(path, format!("the ONNX model cannot be run ({}); copy it again", one_line(&e)))
    })
}

/// The attribute of a node with that name.
pub(super) fn attribute<'n>(node: &'n NodeProto, name: &str) -> Option<&'n AttributeProto> {
    node.attribute.iter().find(|attribute| attribute.name == name)
}

/// The graphs within a node.
pub(super) fn inner_graphs(node: &NodeProto) -> impl Iterator<Item = &GraphProto> {
    node.attribute.iter().flat_map(|attribute| attribute.g.iter().chain(&attribute.graphs))
}

/// The sides of a tensor, where the file states their number.
pub(super) fn stated_sides(port: &ValueInfoProto) -> Option<&[Dimension]> {
    let Value::TensorType(tensor) = port.r#type.as_ref()?.value.as_ref()?;
    Some(&tensor.shape.as_ref()?.dim)
}

/// The files of a network's weights outside the ONNX file, sorted.
///
/// # Errors
/// [`Error::Read`] for one that is not a regular file.
pub(super) fn external_files(path: &Path) -> Result<Vec<PathBuf>> {
    let mut names = BTreeSet::new();
    proto(path)?.graph.iter().for_each(|graph| external(graph, &mut names));
    let folder = path.parent().unwrap_or(Path::new(""));
    let files: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
    for file in &files {
        open::check(file, FileKind::Weights).map_err(|e| Error::read(file, e))?;
    }
    Ok(files)
}

/// Locations of the tensors that a graph keeps in other files.
fn external(graph: &GraphProto, names: &mut BTreeSet<String>) {
    let mut add = |tensor: &TensorProto| {
        let location = tensor.external_data.iter().find(|entry| entry.key == "location");
        names.extend(location.map(|entry| entry.value.clone()));
    };
    graph.initializer.iter().for_each(&mut add);
    let attributes = graph.node.iter().flat_map(|node| &node.attribute);
    attributes.flat_map(|attribute| attribute.t.iter().chain(&attribute.tensors)).for_each(&mut add);
    graph.node.iter().flat_map(inner_graphs).for_each(|inner| external(inner, names));
}
