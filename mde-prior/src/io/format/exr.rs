//! OpenEXR: one channel of depth is read, maps are written.

use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    LineOrder, MetaData, ReadChannels as _, ReadLayers as _, WritableImage as _, read,
};
use ndarray::{Array2, ArrayView2};

use super::{MAX_PIXELS, Parsed, check_size, choose};

/// Names of a depth channel (in any layer), first that of the OpenEXR convention.
const CHANNELS: [&str; 4] = ["z", "depth", "y", "r"];
/// DEFLATE never expands more than 1032 times; a header that needs more is broken.
const MAX_EXPANSION: usize = 1100;

pub(super) fn parse(bytes: &[u8]) -> Parsed<Array2<f32>> {
    check_header(bytes)?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| format!("the OpenEXR file cannot be read ({e}); write it again"))?;
    let mut channels = Vec::new();
    for layer in &image.layer_data {
        let prefix = layer.attributes.layer_name.as_ref().map(|n| format!("{n}.")).unwrap_or_default();
        let list = layer.channel_data.list.iter();
        channels.extend(list.map(|channel| (format!("{prefix}{}", channel.name), layer.size, channel)));
    }
    let names: Vec<&str> = channels.iter().map(|(name, ..)| name.as_str()).collect();
    let last = |name: &str| name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    let usual = CHANNELS.iter().find_map(|usual| names.iter().position(|name| last(name) == *usual));
    let (name, size, channel) = &channels[choose("channel", &names, usual, "Z")?];
    let (width, height) = (size.width(), size.height());
    if channel.sampling.x() != 1 || channel.sampling.y() != 1 {
        return Err(format!("channel {name:?} is subsampled; write it at full size"));
    }
    check_size(width, height)?;
    let values = channel.sample_data.values_as_f32().collect();
    Array2::from_shape_vec((height, width), values).map_err(|e| e.to_string())
}

/// Refuses sizes that the file cannot hold before the decoder allocates memory for them.
fn check_header(bytes: &[u8]) -> Parsed<()> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false)
        .map_err(|e| format!("the file is not in OpenEXR format, or broken ({e}); write it again"))?;
    let mut total = 0_usize;
    for header in &meta.headers {
        let pixels = check_size(header.layer_size.width(), header.layer_size.height())?;
        total = total.saturating_add(pixels.saturating_mul(header.channels.bytes_per_pixel));
    }
    if total > 64 * MAX_PIXELS || total / MAX_EXPANSION > bytes.len() {
        return Err(format!("truncated: its header needs {total} bytes of samples; write the file again"));
    }
    Ok(())
}

pub(super) fn encode(channels: &[(&str, ArrayView2<'_, f32>)]) -> Parsed<Vec<u8>> {
    let (height, width) = channels.first().map(|(_, map)| map.dim()).unwrap_or_default();
    if channels.iter().any(|(_, map)| map.dim() != (height, width)) {
        return Err("the channels are of different sizes; give maps of one size".to_owned());
    }
    let channel = |(name, map): &(&str, ArrayView2<'_, f32>)| {
        AnyChannel::new(*name, FlatSamples::F32(map.iter().copied().collect()))
    };
    let channels = AnyChannels::sort(channels.iter().map(channel).collect());
    // Scan lines from top to bottom and ZIP: every reader has them.
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new((width, height), LayerAttributes::default(), encoding, channels);
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).map_err(|e| e.to_string())?;
    Ok(bytes.into_inner())
}
