//! A raster image with rectangles, text and images.

use font8x8::legacy::BASIC_LEGACY;
use ndarray::{Array3, ArrayView3};

/// Red, green, blue.
pub type Colour = [u8; 3];

/// Side of a glyph before magnification, pixels.
const GLYPH: usize = 8;

/// An RGB image, `[height, width, 3]`. Drawing outside of it is clipped.
pub struct Canvas {
    pixels: Array3<u8>,
}

impl Canvas {
    /// One colour all over.
    pub fn new(width: usize, height: usize, background: Colour) -> Self {
        Self { pixels: Array3::from_shape_fn((height, width, 3), |(_, _, c)| background[c]) }
    }

    /// `[height, width, 3]`.
    pub fn pixels(&self) -> ArrayView3<'_, u8> {
        self.pixels.view()
    }

    fn set(&mut self, x: usize, y: usize, colour: Colour) {
        for (channel, value) in colour.into_iter().enumerate() {
            if let Some(old) = self.pixels.get_mut((y, x, channel)) {
                *old = value;
            }
        }
    }

    /// Draws `colour(column, row)` over a rectangle.
    pub fn paint(
        &mut self,
        [left, top]: [usize; 2],
        [width, height]: [usize; 2],
        colour: impl Fn(usize, usize) -> Colour,
    ) {
        for y in 0..height {
            for x in 0..width {
                self.set(left + x, top + y, colour(x, y));
            }
        }
    }

    /// Writes a line of text with its top left corner at `(left, top)`, magnified; only ASCII can be shown.
    pub fn text(&mut self, text: &str, [left, top]: [usize; 2], magnification: usize, colour: Colour) {
        for (index, character) in text.chars().enumerate() {
            let glyph = BASIC_LEGACY.get(character as usize).unwrap_or(&BASIC_LEGACY[usize::from(b'?')]);
            let start = left + index * GLYPH * magnification;
            for y in 0..GLYPH * magnification {
                for x in 0..GLYPH * magnification {
                    if glyph[y / magnification] >> (x / magnification) & 1 == 1 {
                        self.set(start + x, top + y, colour);
                    }
                }
            }
        }
    }
}

/// Width of a line of text, pixels.
pub fn text_width(text: &str, magnification: usize) -> usize {
    text.chars().count() * GLYPH * magnification
}

/// Height of a line of text, pixels.
pub fn text_height(magnification: usize) -> usize {
    GLYPH * magnification
}

/// sRGB in 0 to 1 as bytes.
pub fn colour_at(image: &Array3<f32>, x: usize, y: usize) -> Colour {
    [0, 1, 2].map(|c| (image[(y, x, c)].clamp(0.0, 1.0) * 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_drawn_where_it_belongs() {
        let mut canvas = Canvas::new(40, 20, [0; 3]);
        canvas.text("H", [4, 2], 2, [255; 3]);
        let lit = |x: usize, y: usize| canvas.pixels()[(y, x, 0)] == 255;
        // Two uprights and nothing between them at the top.
        assert!(lit(4, 2) && lit(14, 2) && !lit(9, 2));
        assert!((0..20).all(|y| (0..40).all(|x| !lit(x, y) || (4..20).contains(&x) && (2..18).contains(&y))));
        canvas.text("outside and not ASCII: é", [30, 15], 3, [9; 3]);
    }
}
