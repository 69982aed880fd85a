//! Files of several photographs: thumbnails, the novel view, and where each pixel's depth comes from.

use anyhow::{Context, Result};
use mde_cli::inputs::size;
use mde_cli::{Capture, CaptureReport};
use mde_prior::format::write_npz;
use mde_prior::photo::write_image;
use std::fs;
use std::path::Path;

/// `[height, width]` arrays `origin` (0 none, 1 prior, 2 consensus, 3 field), `seen` and `confirmed` (numbers of photographs).
pub(crate) const EVIDENCE: &str = "evidence.npz";
/// The photograph that the field renders, and its rendering.
pub(crate) const NOVEL: &str = "views/novel.png";
pub(crate) const RENDERED: &str = "views/rendered.png";

/// The small picture of a photograph.
pub(crate) fn thumbnail(index: usize) -> String {
    format!("views/{index:02}.png")
}

/// Writes them into the folder of a run; `whole`: also the photographs as they are, by their names.
pub(crate) fn write(folder: &Path, capture: &Capture, report: &CaptureReport, whole: bool) -> Result<()> {
    let make = |name: &str| {
        let path = folder.join(name);
        fs::create_dir_all(&path).with_context(|| path.display().to_string())
    };
    make("views")?;
    for (index, photograph) in capture.photographs.iter().enumerate() {
        let small = size::thumbnail(photograph.image.view());
        write_image(folder.join(thumbnail(index)), small.view())?;
    }
    if whole {
        make("photographs")?;
        for photograph in &capture.photographs {
            write_image(folder.join("photographs").join(&photograph.name), photograph.image.view())?;
        }
    }
    if let Some(novel) = &report.novel {
        write_image(folder.join(NOVEL), novel.image.view())?;
        write_image(folder.join(RENDERED), novel.rendered.view())?;
    }
    if let Some(evidence) = &report.evidence {
        let arrays = evidence.arrays();
        write_npz(folder.join(EVIDENCE), &arrays.each_ref().map(|(name, map)| (*name, map.view())))?;
    }
    Ok(())
}
