use super::files::{files_with, id, is_hidden, layout, walk};
use super::truth::TrueDepth;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const EXTENSIONS: [&str; 5] = ["npy", "npz", "pfm", "png", "exr"];

/// A predicted depth map, its truth, and its standard deviation if there is one.
#[derive(Debug, Clone, PartialEq)]
pub struct MapPair {
    /// The path below the folder without its extension.
    pub id: String,
    /// The predicted depth.
    pub prediction: PathBuf,
    /// The true depth.
    pub truth: TrueDepth,
    /// The predicted standard deviation.
    pub sigma: Option<PathBuf>,
}

/// Depth maps of any program, in folders: predictions, truths and, where a folder is named, standard deviations of the same path
/// below their folder, whatever their extensions (`.npy`, `.npz`, `.pfm`, `.png`, `.exr`), belong together. Beside the pairs, by
/// identifier, those of the predictions without a truth.
///
/// # Errors
/// [`Error::Io`] for a folder that cannot be read; [`Error::Layout`] where a folder has no map, no prediction has a
/// truth, a prediction with a truth lacks its sigma, or a map is there in two formats.
pub fn map_pairs(
    predictions: &Path,
    truths: &Path,
    sigmas: Option<&Path>,
) -> Result<(Vec<MapPair>, Vec<String>)> {
    let (predicted, truth_of) = (maps(predictions)?, maps(truths)?);
    let sigma_of = sigmas.map(|folder| Ok::<_, Error>((folder, maps(folder)?))).transpose()?;
    let (mut pairs, mut unmatched) = (Vec::new(), Vec::new());
    for (id, prediction) in predicted {
        let Some(truth) = truth_of.get(&id).cloned().map(TrueDepth::of_file) else {
            unmatched.push(id);
            continue;
        };
        let missing = || format!("no sigma for {id} ({}); add it", prediction.display());
        let sigma = sigma_of
            .as_ref()
            .map(|(folder, of)| of.get(&id).cloned().ok_or_else(|| layout(folder, missing())));
        let sigma = sigma.transpose()?;
        pairs.push(MapPair { id, prediction, truth, sigma });
    }
    if pairs.is_empty() {
        return Err(layout(
            predictions,
            format!("no map has a truth of the same name in {}", truths.display()),
        ));
    }
    Ok((pairs, unmatched))
}

/// Every map at or below a folder by its path without extension.
fn maps(root: &Path) -> Result<BTreeMap<String, PathBuf>> {
    let mut found = BTreeMap::new();
    walk(root, |folder| {
        if folder != root && is_hidden(folder) {
            return Ok(false);
        }
        for path in files_with(folder, &EXTENSIONS)? {
            if let Some(other) = found.insert(id(root, &path.with_extension("")), path.clone()) {
                return Err(layout(&path, format!("is there as {} too; keep one of them", other.display())));
            }
        }
        Ok(true)
    })?;
    if found.is_empty() {
        return Err(layout(root, format!("no depth map (.{})", EXTENSIONS.join(", ."))));
    }
    Ok(found)
}
