//! OpenEXR with the refined depth as Y and Z, its sigma and the prior.

use crate::error::{Error, Result};
use crate::output::export::Exported;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    LineOrder, SmallVec, WritableImage as _,
};
use ndarray::ArrayView2;
use std::io::Cursor;

pub(super) fn encode(scene: &Exported<'_>) -> Result<Vec<u8>> {
    let (height, width) = scene.depth.dim();
    let sigma = scene.depth.sigma();
    let channel = |name: &str, map: ArrayView2<'_, f32>| {
        AnyChannel::new(name, FlatSamples::F32(map.iter().copied().collect()))
    };
    let channels = AnyChannels::sort(SmallVec::from_iter([
        // OpenCV reads a luminance or colours alone; Nuke and Blender look for Z.
        channel("Y", scene.depth.mean()),
        channel("Z", scene.depth.mean()),
        channel("sigma", sigma.view()),
        channel("prior", scene.prior),
    ]));
    // Scan lines from top to bottom and ZIP: every reader has them.
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new((width, height), LayerAttributes::default(), encoding, channels);
    let mut bytes = Cursor::new(Vec::new());
    let write = Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes);
    write.map_err(|error| Error::external(format!("depth.exr can't be made: {error}")))?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::export::tests::with_plane;
    use mde_prior::format::{ReadOptions, read_values};

    #[test]
    fn every_channel_is_read_back_as_it_was() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("depth.exr");
        with_plane(|scene| {
            std::fs::write(&path, encode(scene).unwrap()).unwrap();
            let read = |channel: Option<&str>| {
                let options =
                    ReadOptions { exr_channel: channel.map(str::to_owned), ..ReadOptions::default() };
                read_values(&path, &options).unwrap()
            };
            // Without a word the refined depth.
            assert_eq!(read(None), scene.depth.mean());
            assert_eq!(read(Some("Y")), scene.depth.mean());
            assert_eq!(read(Some("sigma")), scene.depth.sigma());
            assert_eq!(read(Some("prior")), scene.prior);
        });
    }
}
