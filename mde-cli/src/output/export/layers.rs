//! OpenEXR with the refined depth as Y and Z, its sigma and the prior.

use crate::error::{Error, Result};
use crate::several::cloud::RefinedView;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    LineOrder, SmallVec, WritableImage as _,
};
use ndarray::ArrayView2;
use std::io::Cursor;

pub(crate) fn encode(view: &RefinedView<'_>, prior: ArrayView2<'_, f32>) -> Result<Vec<u8>> {
    let (height, width) = view.depth.dim();
    let channel = |name: &str, map: ArrayView2<'_, f32>| {
        AnyChannel::new(name, FlatSamples::F32(map.iter().copied().collect()))
    };
    let channels = AnyChannels::sort(SmallVec::from_iter([
        // OpenCV reads a luminance or colours alone; Nuke and Blender look for Z.
        channel("Y", view.depth),
        channel("Z", view.depth),
        channel("sigma", view.sigma),
        channel("prior", prior),
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
