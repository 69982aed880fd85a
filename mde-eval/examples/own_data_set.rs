//! A data set of your own in thirty lines: pictures with depth maps beside them, `NAME.jpg` and `NAME.npy` (metres).
//! `cargo run -p mde-eval --example own_data_set -- FOLDER`.
#![allow(clippy::print_stdout)]

use mde_eval::data::{DataSet, Sample};
use mde_eval::mde_prior::format::{ReadOptions, read_depth};
use mde_eval::mde_prior::photo::read_image;
use mde_eval::mde_warp::PinholeCamera;
use mde_eval::{Error, Result};
use std::path::PathBuf;

struct Flat {
    folder: PathBuf,
    ids: Vec<String>,
}

impl Flat {
    fn open(folder: PathBuf) -> Result<Self> {
        let fault = |source| Error::Io { path: folder.clone(), source };
        let paths = std::fs::read_dir(&folder).map_err(fault)?.flatten().map(|entry| entry.path());
        let pictures = paths.filter(|path| path.extension().is_some_and(|e| e == "jpg"));
        let mut ids: Vec<_> =
            pictures.filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned())).collect();
        ids.sort();
        Ok(Self { folder, ids })
    }
}

impl DataSet for Flat {
    fn ids(&self) -> &[String] {
        &self.ids
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let id = self.ids.get(index).ok_or(Error::Scene { index, count: self.ids.len() })?.clone();
        let image = read_image(self.folder.join(format!("{id}.jpg")))?.pixels;
        let depth = read_depth(self.folder.join(format!("{id}.npy")), &ReadOptions::default())?;
        let camera = PinholeCamera::from_fov(60.0, image.dim().1, image.dim().0)?;
        Ok(Sample { assumed_camera: true, trusted_depth: 10.0, ..Sample::new(id, image, depth, camera) })
    }
}

fn main() -> Result<()> {
    let data = Flat::open(std::env::args().nth(1).unwrap_or_else(|| ".".to_owned()).into())?;
    println!("{} scenes: {:?}", data.ids().len(), data.ids());
    Ok(())
}
