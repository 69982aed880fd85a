//! Saved fields: as they are, and with a header whose checksum was put right, so that what lies behind it is reached.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::mde_nerf::{Nerf, RadianceField};
use mde_cli::mde_warp::{PinholeCamera, Pose};
use mde_fuzz::folder;
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use std::collections::HashMap;
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

/// The same tensors with the checksums that they and the header should have.
fn mended(bytes: &[u8]) -> Option<Vec<u8>> {
    let tensors = SafeTensors::deserialize(bytes).ok()?;
    let (_, metadata) = SafeTensors::read_metadata(bytes).ok()?;
    let header = metadata.metadata().as_ref()?.get("mde-nerf")?;
    let mut header: serde_json::Value = serde_json::from_str(header).ok()?;
    let parts: Vec<_> = ["table", "network"]
        .into_iter()
        .map(|name| Some((name, tensors.tensor(name).ok()?)))
        .collect::<Option<_>>()?;
    let mut hasher = crc32fast::Hasher::new();
    parts.iter().for_each(|(_, tensor)| hasher.update(tensor.data()));
    *header.get_mut("checksum")? = hasher.finalize().into();
    *header.get_mut("header_checksum")? = "00000000".into();
    let blank = header.to_string();
    let own = format!("\"header_checksum\":\"{:08x}\"", crc32fast::hash(blank.as_bytes()));
    let header = blank.replace("\"header_checksum\":\"00000000\"", &own);
    let views = parts
        .iter()
        .map(|(name, t)| Some((*name, TensorView::new(Dtype::F32, vec![t.data().len() / 4], t.data()).ok()?)))
        .collect::<Option<Vec<_>>>()?;
    safetensors::serialize(views, Some(HashMap::from([("mde-nerf".to_owned(), header)]))).ok()
}

fuzz_target!(|data: &[u8]| {
    load(data);
    if let Some(bytes) = mended(data) {
        load(&bytes);
    }
});
