//! The monocular depth that the command line names.

use crate::prior::{OpenPrior, read_options};
use crate::program::{NetworkArgs, PriorArgs};
use anyhow::Result;
use std::path::Path;

/// The prior of one photograph, or of `several`, which need none.
pub(crate) fn open(args: &PriorArgs, several: bool) -> Result<OpenPrior<'static>> {
    match (&args.prior_model, &args.prior_depth) {
        (Some(model), _) => network(model, &args.network),
        (None, Some(file)) => map(file, &args.network),
        (None, None) if several => Ok(OpenPrior::nothing()),
        (None, None) => anyhow::bail!(
            "one photograph needs a depth network: give --prior-model MODEL.onnx or --prior-depth; `curl -Lo depth-anything-v2-small.onnx \
             https://huggingface.co/onnx-community/depth-anything-v2-small/resolve/main/onnx/model.onnx` gets one, docs/models.md has more; \
             several photographs of one place (--views) need none"
        ),
    }
}

pub(crate) fn map(path: &Path, args: &NetworkArgs) -> Result<OpenPrior<'static>> {
    let options = read_options("--png-scale", args.png_scale)?;
    Ok(OpenPrior::map_file(path, args.prior_kind, options)?)
}

#[cfg(feature = "onnx")]
pub(crate) fn network(path: &Path, args: &NetworkArgs) -> Result<OpenPrior<'static>> {
    let runtime = runtime(args.runtime.as_deref())?;
    Ok(OpenPrior::network(path, args.model_profile.as_deref(), args.prior_kind, &runtime)?)
}

#[cfg(not(feature = "onnx"))]
pub(crate) fn network(path: &Path, _: &NetworkArgs) -> Result<OpenPrior<'static>> {
    let path = path.display();
    anyhow::bail!(
        "{path}: this program was built without ONNX; build it with --features onnx, or use --prior-depth"
    )
}

/// What runs a network: `tract`, `auto`, `onnxruntime` or a library's path.
#[cfg(feature = "onnx")]
pub(crate) fn runtime(wanted: Option<&str>) -> Result<mde_prior::Runtime> {
    let wanted = wanted.unwrap_or("tract");
    #[cfg(feature = "onnxruntime")]
    if wanted != "tract" {
        let named = (!["auto", "onnxruntime"].contains(&wanted)).then(|| Path::new(wanted));
        if let Some(library) = mde_prior::find_onnxruntime(named) {
            return Ok(mde_prior::Runtime::OnnxRuntime(library));
        }
        anyhow::ensure!(
            wanted == "auto",
            "--runtime {wanted}: no library of ONNX Runtime was found; install it (pip install onnxruntime), or give the library's path here or as \
             ORT_DYLIB_PATH"
        );
    }
    #[cfg(not(feature = "onnxruntime"))]
    anyhow::ensure!(
        ["tract", "auto"].contains(&wanted),
        "--runtime {wanted}: this program was built without ONNX Runtime; build it with --features onnxruntime, or give tract"
    );
    Ok(mde_prior::Runtime::Tract)
}
