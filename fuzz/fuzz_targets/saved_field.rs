//! Saved fields: as they are, and with the checksum put right, so that what lies behind it is reached.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::mde_nerf::{Nerf, RadianceField};
use mde_cli::mde_warp::{PinholeCamera, Pose};
use mde_fuzz::folder;
use safetensors::SafeTensors;
use std::ops::ControlFlow;

fn load(bytes: &[u8]) {
    let file = folder(&[("field.safetensors", bytes)]).join("field.safetensors");
    if let Ok(field) = Nerf::load(file) {
        let camera = PinholeCamera::from_fov(60.0, 4, 3).expect("a camera");
        let mut go_on = |_: &mde_cli::mde_nerf::FieldEvent| ControlFlow::Continue(());
        if let Ok(view) = field.render(&camera, &Pose::identity(), &mut go_on) {
            assert!(view.depth.mean().iter().all(|d| !d.is_nan()));
        }
    }
}

/// The same with the checksum that it should have.
fn mended(bytes: &[u8]) -> Option<Vec<u8>> {
    let tensors = SafeTensors::deserialize(bytes).ok()?;
    let (_, metadata) = SafeTensors::read_metadata(bytes).ok()?;
    let mut entries = metadata.metadata().clone()?;
    let parts = ["network", "table"].map(|name| Some((name, tensors.tensor(name).ok()?)));
    let parts = parts.into_iter().collect::<Option<Vec<_>>>()?;
    let mut hasher = crc32fast::Hasher::new();
    let header = entries.get("mde-nerf")?.split_once(' ')?.1.to_owned();
    hasher.update(header.as_bytes());
    parts.iter().for_each(|(_, tensor)| hasher.update(tensor.data()));
    entries.insert("mde-nerf".to_owned(), format!("{:08x} {header}", hasher.finalize()));
    safetensors::serialize(parts, Some(entries)).ok()
}

fuzz_target!(|data: &[u8]| {
    load(data);
    if let Some(bytes) = mended(data) {
        load(&bytes);
    }
});
