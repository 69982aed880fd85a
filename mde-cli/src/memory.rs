//! How much memory a run will take, before it takes it.

use crate::Config;
use mde_nerf::FieldConfig;

/// The program, its threads' tiles and what it allocates whatever the picture.
const BASE: u64 = 64 << 20;
/// Bytes a pixel for the picture, the prior, the maps and what a stage holds for a while.
const PIXEL: u64 = 220;
/// Bytes a pixel and training view: colours, mask, depth, variance, the list of trainable pixels.
const VIEW: u64 = 25;
/// Bytes a pixel and rendered view: depth, variance and their way back.
const RENDERED: u64 = 16;
/// Floats a parameter of a field: itself, its gradient, two moments, an average, a copy.
const PARAMETER: u64 = 6 * 4;

/// Bytes that [`refine`](crate::refine) takes at most for a picture of that many pixels, measured to be 1.1 to 2 times what
/// it does take; without what the prior itself needs to answer.
pub fn refine_bytes(pixels: u64, config: &Config) -> u64 {
    let views = (config.views.count as u64).saturating_add(1);
    let rendered = (config.novel.sampling.count as u64).saturating_add(u64::from(config.novel.original));
    let per_pixel =
        PIXEL.saturating_add(VIEW.saturating_mul(views)).saturating_add(RENDERED.saturating_mul(rendered));
    BASE.saturating_add(pixels.saturating_mul(per_pixel)).saturating_add(field_bytes(&config.nerf.field))
}

/// Bytes that rendering `views` views of so many pixels takes at most.
pub fn render_bytes(pixels: u64, views: u64) -> u64 {
    BASE.saturating_add(pixels.saturating_mul(64 + 24 * views))
}

fn field_bytes(field: &FieldConfig) -> u64 {
    let parameters = match field {
        FieldConfig::Mlp(f) => (f.layers as u64 + 1) * (f.width as u64).pow(2),
        FieldConfig::Hash(f) => {
            let rows = 1_u64 << f.log2_rows.min(32);
            f.levels as u64 * f.features as u64 * rows + (f.layers as u64 + 2) * (f.width as u64).pow(2)
        }
    };
    PARAMETER * parameters
}

/// The most pixels for which `bytes` stays within `bound`, if any do.
pub fn most_pixels(bound: u64, bytes: impl Fn(u64) -> u64) -> Option<u64> {
    let (mut fits, mut fails) = (0, 1_u64 << 40);
    while fails - fits > 1 {
        let middle = fits + (fails - fits) / 2;
        *if bytes(middle) <= bound { &mut fits } else { &mut fails } = middle;
    }
    (fits > 0).then_some(fits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Preset;

    #[test]
    fn the_estimate_grows_with_everything_and_never_overflows() {
        let config = Preset::Default.config();
        let bytes = |pixels| refine_bytes(pixels, &config);
        assert!(bytes(640 * 480) < 1 << 30 && bytes(20_000_000) > 8 << 30);
        let mut more = config.clone();
        more.views.count = usize::MAX;
        assert_eq!(refine_bytes(u64::MAX, &more), u64::MAX);
        let most = most_pixels(8 << 30, bytes).unwrap();
        assert!(bytes(most) <= 8 << 30 && bytes(most + 1) > 8 << 30);
        assert_eq!(most_pixels(1, bytes), None);
    }
}
