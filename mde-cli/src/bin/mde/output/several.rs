//! Files of several photographs: thumbnails, the novel view, and where each pixel's depth comes from.

use anyhow::{Context, Result};
use mde_cli::capture::{Evidence, Origin};
use mde_cli::inputs::size::resized;
use mde_cli::{Capture, CaptureReport};
use mde_prior::format::write_npz;
use mde_prior::photo::write_image;
use ndarray::Array2;
use std::fs;
use std::path::Path;

/// `[height, width]` arrays `origin` (0 none, 1 prior, 2 consensus, 3 field), `seen` and `confirmed` (numbers of photographs).
pub(crate) const EVIDENCE: &str = "evidence.npz";
/// The photograph that the field renders, and its rendering.
pub(crate) const NOVEL: &str = "views/novel.png";
pub(crate) const RENDERED: &str = "views/rendered.png";
/// Longer side of a thumbnail, pixels.
const THUMBNAIL: usize = 240;

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
        let (height, width) = photograph.mask.dim();
        let longer = height.max(width).max(1);
        let side = |side: usize| if longer > THUMBNAIL { (side * THUMBNAIL / longer).max(1) } else { side };
        let small = resized(photograph.image.view(), side(width), side(height));
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
    if let Some(Evidence { origin, seen, confirmed }) = &report.evidence {
        let origin = origin.mapv(|origin| match origin {
            Origin::Missing => 0.0,
            Origin::Prior => 1.0,
            Origin::Consensus => 2.0,
            Origin::Field => 3.0,
        });
        let count = |map: &Array2<u8>| map.mapv(f32::from);
        let (seen, confirmed) = (count(seen), count(confirmed));
        let arrays = [("origin", origin.view()), ("seen", seen.view()), ("confirmed", confirmed.view())];
        write_npz(folder.join(EVIDENCE), &arrays)?;
    }
    Ok(())
}
