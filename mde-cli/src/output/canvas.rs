//! A raster image with rectangles, text and images.

use crate::scene::size::byte;
use ab_glyph::{Font, FontRef, ScaleFont};
use ndarray::Array3;
use std::sync::LazyLock;

/// Red, green, blue.
pub(super) type Colour = [u8; 3];

/// The font of the figures too. No test passes without it, so that it is there.
static FONT: LazyLock<Option<FontRef<'static>>> =
    LazyLock::new(|| FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT).ok());

/// An RGB image, `[height, width, 3]`. Drawing outside of it is clipped.
pub(super) struct Canvas {
    pub(super) pixels: Array3<u8>,
}

impl Canvas {
    /// One colour all over.
    pub(super) fn new(width: usize, height: usize, background: Colour) -> Self {
        Self { pixels: Array3::from_shape_fn((height, width, 3), |(_, _, c)| background[c]) }
    }

    /// Draws an image, sRGB in 0 to 1 `[height, width, 3]`, with its top left corner there.
    pub(super) fn image(&mut self, at: [usize; 2], image: &Array3<f32>) {
        let (height, width, _) = image.dim();
        self.paint(at, [width, height], |x, y| [0, 1, 2].map(|c| byte(image[(y, x, c)])));
    }

    /// Draws `colour(column, row)` over a rectangle.
    pub(super) fn paint(
        &mut self,
        [left, top]: [usize; 2],
        [width, height]: [usize; 2],
        colour: impl Fn(usize, usize) -> Colour,
    ) {
        let rows = self.pixels.outer_iter_mut().skip(top).take(height).enumerate();
        for (y, mut row) in rows {
            for (x, mut pixel) in row.outer_iter_mut().skip(left).take(width).enumerate() {
                pixel.iter_mut().zip(colour(x, y)).for_each(|(old, new)| *old = new);
            }
        }
    }

    /// Mixes the colour over a pixel.
    fn mix(&mut self, x: usize, y: usize, colour: Colour, share: f32) {
        for (channel, value) in colour.into_iter().enumerate() {
            if let Some(old) = self.pixels.get_mut((y, x, channel)) {
                *old = (f32::from(*old) + share * (f32::from(value) - f32::from(*old))).round() as u8;
            }
        }
    }

    /// Writes a line of text of that [height](text_width) with its top left corner at `(left, top)`.
    pub(super) fn text(&mut self, text: &str, [left, top]: [usize; 2], height: usize, colour: Colour) {
        let Some(font) = &*FONT else { return };
        let scaled = font.as_scaled(height as f32);
        let mut next = 0.0;
        for character in text.chars() {
            let (id, at) = (font.glyph_id(character), next);
            next += scaled.h_advance(id);
            let Some(outline) = font.outline_glyph(id.with_scale(height as f32)) else { continue };
            let bounds = outline.px_bounds();
            let (x0, y0) = (left as f32 + at + bounds.min.x, top as f32 + scaled.ascent() + bounds.min.y);
            outline.draw(|x, y, share| {
                let (x, y) = (x0.round() + x as f32, y0.round() + y as f32);
                if x >= 0.0 && y >= 0.0 {
                    self.mix(x as usize, y as usize, colour, share.clamp(0.0, 1.0));
                }
            });
        }
    }
}

/// Width of a line of text, pixels. Its height is from the top of the highest letters to the bottom of the lowest.
pub(super) fn text_width(text: &str, height: usize) -> usize {
    let Some(font) = &*FONT else { return 0 };
    let scaled = font.as_scaled(height as f32);
    text.chars().map(|c| scaled.h_advance(font.glyph_id(c))).sum::<f32>().ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_drawn_where_it_belongs() {
        let mut canvas = Canvas::new(60, 40, [0; 3]);
        canvas.text("H", [4, 2], 24, [255; 3]);
        let width = text_width("H", 24);
        let dark = |x: usize, y: usize| canvas.pixels[(y, x, 0)] == 0;
        assert!(
            (0..40)
                .all(|y| (0..60).all(|x| dark(x, y) || (4..4 + width).contains(&x) && (2..26).contains(&y)))
        );
        // Two uprights and a bar between them.
        let middle = 4 + width / 2;
        let lit: Vec<usize> = (0..40).filter(|y| !dark(middle, *y)).collect();
        assert!(!lit.is_empty() && lit.len() <= 3, "{lit:?}");
        assert!((4..middle).any(|x| (8..16).all(|y| !dark(x, y))));
        canvas.text("outside, and not ASCII: é", [50, 35], 30, [9; 3]);
        assert!(text_width("HH", 24) > text_width("H", 24));
    }
}
