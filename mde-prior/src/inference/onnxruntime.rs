//! Networks run by ONNX Runtime, a library that is loaded when it is asked for.

use super::graph::{Graph, Output, Port, image_input};
use crate::InferenceMemory;
use ort::environment::Environment;
use ort::session::{Session, SessionInputValue};
use ort::value::{Outlet, Tensor, TensorElementType, ValueType};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The library, of which a process has one.
static ENVIRONMENT: Mutex<Option<Environment>> = Mutex::new(None);

/// Bytes of the library and of a session, and of the tensors per value of the input, since the library states none: measured with
/// FastDepth and a network of Depth Anything V2 Small's architecture.
const LIBRARY: u64 = 20 << 20;
const VALUE: u64 = 226;

/// One prediction at a time, on all threads.
pub(super) struct OnnxRuntimeGraph {
    session: Mutex<Session>,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    tokens: Option<u32>,
}

impl OnnxRuntimeGraph {
    /// The graph in the file `path` with `tokens` for its inputs other than the image. `library` is `libonnxruntime.so`, `.dylib` or
    /// `.dll`; a process loads one: the first.
    pub(super) fn open(path: &Path, library: &Path, tokens: Option<u32>) -> Result<Self, String> {
        let failed =
            |e: ort::Error| format!("ONNX Runtime cannot run the model ({}); export it again", line(&e));
        let mut kept = ENVIRONMENT.lock().unwrap_or_else(PoisonError::into_inner);
        let environment = match &*kept {
            Some(environment) => environment,
            None => {
                let made = ort::init_from(library)
                    .map_err(|e| format!("{}; give the path of ONNX Runtime's library", line(&e)))?
                    .build()
                    .map_err(failed)?;
                kept.insert(made)
            }
        };
        let threads = rayon::current_num_threads();
        let session = Session::builder(environment)
            .and_then(|builder| builder.with_intra_threads(threads).map_err(ort::Error::from))
            .and_then(|mut builder| builder.commit_from_file(path))
            .map_err(failed)?;
        let ports = |outlets: &[Outlet]| outlets.iter().map(port).collect();
        let (inputs, outputs) = (ports(session.inputs()), ports(session.outputs()));
        Ok(Self { session: Mutex::new(session), inputs, outputs, tokens })
    }
}

impl Graph for OnnxRuntimeGraph {
    fn ports(&self) -> (&[Port], &[Port]) {
        (&self.inputs, &self.outputs)
    }

    fn run(&self, shape: [usize; 4], values: Vec<f32>, wanted: &[usize]) -> Result<Vec<Output>, String> {
        let failed =
            |e: ort::Error| format!("the model fails at {shape:?} ({}); check its input size", line(&e));
        let missing = || "the model has no such output; export it again".to_owned();
        let image = image_input(&self.inputs, self.tokens)?;
        let mut inputs: Vec<(String, SessionInputValue<'_>)> = Vec::new();
        for (index, port) in self.inputs.iter().enumerate().filter(|(index, _)| *index != image) {
            let axes = self.inputs[index].sides.as_ref().map_or(0, Vec::len);
            let number = vec![i64::from(self.tokens.unwrap_or_default())];
            let number = Tensor::from_array((vec![1_i64; axes], number)).map_err(failed)?;
            inputs.push((port.name.clone(), number.into()));
        }
        let values = Tensor::from_array((shape.map(|side| side as i64), values)).map_err(failed)?;
        inputs.push((self.inputs[image].name.clone(), values.into()));
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        let outputs = session.run(inputs).map_err(failed)?;
        let output = |index: &usize| {
            let name = &self.outputs.get(*index).ok_or_else(missing)?.name;
            let value = outputs.get(name).ok_or_else(missing)?;
            let (shape, values) = value.try_extract_tensor::<f32>().map_err(failed)?;
            let shape = shape.iter().map(|side| usize::try_from(*side).unwrap_or(0)).collect();
            Ok(Output { shape, values: values.to_vec() })
        };
        wanted.iter().map(output).collect()
    }

    fn memory(&self, shape: [usize; 4], _: &[usize]) -> Result<InferenceMemory, String> {
        let values = shape.iter().map(|side| *side as u64).product::<u64>();
        Ok(InferenceMemory { model: LIBRARY, prediction: VALUE.saturating_mul(values) })
    }

    fn concurrency(&self) -> usize {
        1
    }
}

fn port(outlet: &Outlet) -> Port {
    let (other_type, sides) = match outlet.dtype() {
        ValueType::Tensor { ty, shape, .. } => {
            let other = (*ty != TensorElementType::Float32).then(|| format!("{ty:?}"));
            (other, Some(shape.iter().map(|side| usize::try_from(*side).ok()).collect()))
        }
        _ => (Some("no tensor".to_owned()), None),
    };
    Port { name: outlet.name().to_owned(), sides, other_type }
}

fn line(error: &dyn std::fmt::Display) -> String {
    super::runtime::shortened(&error.to_string())
}

/// ONNX Runtime's library: `named`, else the environment's `ORT_DYLIB_PATH`, else beside the program, else in the `onnxruntime` package
/// of the active Python (`VIRTUAL_ENV`, `CONDA_PREFIX`, or that of `python3`).
#[must_use]
pub fn find_library(named: Option<&Path>) -> Option<PathBuf> {
    let stated = || std::env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()).map(PathBuf::from);
    let beside = || std::env::current_exe().ok()?.parent().and_then(library_in);
    let of_package = |packages: PathBuf| library_in(&packages.join("onnxruntime/capi"));
    let in_python = || python_packages().into_iter().find_map(of_package);
    named.map(Path::to_owned).or_else(stated).or_else(beside).or_else(in_python)
}

/// The library in a folder: the first by name of those that are it, with or without a version.
fn library_in(folder: &Path) -> Option<PathBuf> {
    let names = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        name.starts_with("libonnxruntime.so")
            || (name.starts_with("libonnxruntime") && name.ends_with(".dylib"))
            || name == "onnxruntime.dll"
    };
    std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).filter(names).min()
}

/// Folders of the active Python's packages.
fn python_packages() -> Vec<PathBuf> {
    let roots = ["VIRTUAL_ENV", "CONDA_PREFIX"].iter().filter_map(std::env::var_os).map(PathBuf::from);
    let in_root = |root: PathBuf| {
        let versions = std::fs::read_dir(root.join("lib")).into_iter().flatten().flatten();
        versions.map(|entry| entry.path().join("site-packages")).filter(|path| path.is_dir())
    };
    let mut folders: Vec<PathBuf> = roots.flat_map(in_root).collect();
    folders.sort();
    let script = "import site, sys; print('\\n'.join(site.getsitepackages() + [site.getusersitepackages()]))";
    if let Ok(output) = std::process::Command::new("python3").args(["-c", script]).output() {
        folders.extend(String::from_utf8_lossy(&output.stdout).lines().map(PathBuf::from));
    }
    folders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_is_found_by_its_name_with_or_without_a_version() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(library_in(folder.path()), None);
        std::fs::write(folder.path().join("onnxruntime_pybind11_state.so"), "").unwrap();
        assert_eq!(library_in(folder.path()), None);
        let library = folder.path().join("libonnxruntime.so.1.31.1");
        std::fs::write(&library, "").unwrap();
        assert_eq!(library_in(folder.path()), Some(library));
        assert_eq!(find_library(Some(Path::new("mine.so"))), Some(PathBuf::from("mine.so")));
    }
}
