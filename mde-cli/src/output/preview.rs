//! Preview images: depth maps side by side with colour bars, and contact sheets of views.

use crate::output::canvas::{Canvas, Colour, text_width};
use crate::output::files::ResultFiles;
use crate::scene::{Image, byte};
use colorous::{Gradient, MAGMA, SPECTRAL};
use mde_prior::resample::{nearest, shrink};
use mde_uncertainty::statistics::quantile;
use mde_warp::PosedView;
use ndarray::{Array2, Array3, ArrayView2, Axis, Zip};
use std::sync::LazyLock;

const BACKGROUND: Colour = [255; 3];
const INK: Colour = [20; 3];
const MISSING: Colour = [128; 3];
const MARGIN: usize = 8;
/// Height of a colour bar, pixels.
const BAR: usize = 14;
/// Panels are not wider than this, and not narrower than the other.
const WIDEST: usize = 640;
const NARROWEST: usize = 240;
/// The colours of sigma over depth, the same on all pictures.
pub const RELATIVE: [f64; 2] = [0.0, 0.3];
/// Height of a [`thumbnail`].
const SMALL: usize = 120;
/// Width of a picture on a contact sheet.
const THUMBNAIL: usize = 240;
const COLUMNS: usize = 4;

/// Colours of a gradient at even steps, more than a channel has: its curve takes longer than all else of a picture.
type Palette = [Colour; 1024];

/// Evenly in the inverse depth, so that near edges and far ones are seen.
static DEPTHS: LazyLock<Colours> = LazyLock::new(|| Colours::new(SPECTRAL, |z| -1.0 / z));
static OTHERS: LazyLock<Colours> = LazyLock::new(|| Colours::new(MAGMA, |value| value));

/// The colours of a map: their place along the palette is linear in what `of` makes of a value.
struct Colours {
    palette: Palette,
    of: fn(f64) -> f64,
}

impl Colours {
    fn new(gradient: Gradient, of: fn(f64) -> f64) -> Self {
        let palette = std::array::from_fn(|step| gradient.eval_continuous(step as f64 / 1023.0).as_array());
        Self { palette, of }
    }

    /// The colour at a share in 0 to 1.
    fn at(&self, share: f64) -> Colour {
        self.palette[((1023.0 * share + 0.5) as usize).min(1023)]
    }

    /// The colour of a value of that range.
    fn shade(&self, value: f32, [low, high]: [f64; 2]) -> Colour {
        if !known(value) {
            return MISSING;
        }
        let [value, first, last] = [f64::from(value), low, high].map(self.of);
        self.at(if high > low { ((value - first) / (last - first)).clamp(0.0, 1.0) } else { 0.5 })
    }
}

/// Image, prior, refined and sigma / depth side by side; with several photographs these are above, and the truth, where it is known, takes
/// the place of the image. Without a network the number of photographs that confirm a pixel stands at the end in place of the prior. All
/// depths share one scale, from 1 % to 99 % of the pixels of prior and refined.
pub fn preview(show: &ResultFiles<'_>) -> Array3<u8> {
    let (rows, columns, _) = show.image.dim();
    let (refined, unit) = (show.depth.mean(), show.png.unit);
    let [width, whole] = widths(columns);
    let height = (rows * width).div_ceil(columns.max(1)).clamp(1, 4 * WIDEST);
    let text = text_height(width);
    let first = 2 * MARGIN + text;
    let above = show.beside.strip.first().map_or(0, |picture| first + picture.dim().0 + MARGIN);
    let title = above + MARGIN;
    let top = title + MARGIN + text;
    let panel = [width, height];
    let bottom = top + height + 3 * MARGIN + BAR + text;
    let mut canvas = Canvas::new(whole, bottom, BACKGROUND);
    let mut left = MARGIN;
    for picture in &show.beside.strip {
        canvas.image([left, first], picture);
        left += picture.dim().1 + MARGIN;
    }
    if !show.beside.strip.is_empty() {
        canvas.text("photographs, the first is refined", [MARGIN, MARGIN], text, INK);
    }

    let [depths, prior] = [usual_range(show.prior.iter().chain(refined)), usual_range(show.prior.iter())];
    let relative = relative_sigma(refined, show.sigma);
    let depth = |name: &str, map| (format!("{name} [{unit}]"), map, &*DEPTHS, depths);
    let mut maps = vec![depth("refined", refined)];
    if prior[1] > prior[0] {
        maps.insert(0, depth("prior", show.prior));
    }
    match show.beside.truth.filter(|_| !show.beside.strip.is_empty()) {
        Some(truth) => maps.push(depth("truth", truth)),
        None => {
            canvas.text("image", [MARGIN, title], text, INK);
            canvas.image([MARGIN, top], &shrink(show.image, (height, width)));
        }
    }
    maps.push(("sigma / depth".to_owned(), relative.view(), &*OTHERS, RELATIVE));
    let confirmed = show.beside.evidence.iter().find(|(name, _)| *name == "confirmed");
    if let (true, Some((_, map))) = (prior[1] <= prior[0], confirmed) {
        let most = map.iter().fold(1.0_f32, |most, count| most.max(*count));
        maps.push(("confirmed by [photographs]".to_owned(), *map, &*OTHERS, [0.0, f64::from(most)]));
    }
    let first = 4_usize.saturating_sub(maps.len());
    for (index, (name, map, colours, range)) in maps.iter().take(4).enumerate() {
        let left = MARGIN + (index + first) * (width + MARGIN);
        canvas.text(name, [left, title], text, INK);
        canvas.paint([left, top], panel, |x, y| {
            colours.shade(map[(y * rows / height, x * columns / width)], *range)
        });
        colour_bar(&mut canvas, [left, top + height + MARGIN], width, colours, *range, text);
    }
    canvas.pixels
}

/// Photograph, depth and sigma / depth side by side, 120 pixels high.
pub fn thumbnail(show: &ResultFiles<'_>) -> Array3<u8> {
    let (rows, columns, _) = show.image.dim();
    let size = (SMALL, (columns * SMALL / rows.max(1)).clamp(1, 4 * SMALL));
    let [depth, sigma] = [show.depth.mean(), show.sigma].map(|map| nearest(map, size));
    let relative = sigma_picture_within(relative_sigma(depth.view(), sigma.view()).view(), RELATIVE);
    let parts = [shrink(show.image, size).mapv(byte), depth_picture(depth.view()), relative];
    let mut all = Array3::zeros((SMALL, parts.len() * size.1, 3));
    let places = all.axis_chunks_iter_mut(Axis(1), size.1);
    parts.iter().zip(places).for_each(|(part, mut place)| place.assign(part));
    all
}

/// Height of the text beside panels of that width.
fn text_height(width: usize) -> usize {
    width / 28 + 8
}

/// Width of a panel and of the preview of an image with that many columns.
fn widths(columns: usize) -> [usize; 2] {
    let width = columns.clamp(NARROWEST, WIDEST);
    [width, 4 * width + 5 * MARGIN]
}

/// Photographs `[height, width, 3]` at one height, to stand in a row above the [`preview`] of an image with that many columns. Empty
/// for fewer than two.
pub fn strip(photographs: &[Image], columns: usize) -> Vec<Array3<f32>> {
    let shapes = photographs.iter().map(|p| p.dim().1 as f64 / p.dim().0.max(1) as f64);
    let all: f64 = shapes.sum();
    if photographs.len() < 2 || all <= 0.0 {
        return Vec::new();
    }
    let [_, whole] = widths(columns);
    let inner = whole.saturating_sub(MARGIN * (photographs.len() + 1));
    let height = ((inner as f64 / all) as usize).clamp(1, THUMBNAIL);
    let small = |photograph: &Image| {
        let (rows, columns, _) = photograph.dim();
        shrink(photograph.view(), (height, (columns * height / rows.max(1)).max(1)))
    };
    photographs.iter().map(small).collect()
}

/// A depth map as a colour picture, `[height, width, 3]` bytes.
pub fn depth_picture(depth: ArrayView2<'_, f32>) -> Array3<u8> {
    depth_picture_within(depth, usual_range(depth.iter()))
}

/// The same with the colours from one depth to another.
pub fn depth_picture_within(depth: ArrayView2<'_, f32>, range: [f64; 2]) -> Array3<u8> {
    picture(depth, &DEPTHS, range)
}

/// A map of sigma as a colour picture.
pub fn sigma_picture_within(sigma: ArrayView2<'_, f32>, range: [f64; 2]) -> Array3<u8> {
    picture(sigma, &OTHERS, range)
}

fn picture(map: ArrayView2<'_, f32>, colours: &Colours, range: [f64; 2]) -> Array3<u8> {
    let mut canvas = Canvas::new(map.ncols(), map.nrows(), MISSING);
    canvas.paint([0, 0], [map.ncols(), map.nrows()], |x, y| colours.shade(map[(y, x)], range));
    canvas.pixels
}

/// Sigma over depth, `[height, width]`; infinite where the depth is missing.
pub fn relative_sigma(depth: ArrayView2<'_, f32>, sigma: ArrayView2<'_, f32>) -> Array2<f32> {
    Zip::from(depth).and(sigma).map_collect(|z, s| if *z > 0.0 { s / z } else { f32::INFINITY })
}

/// All views on one sheet, masked pixels in red.
pub fn contact_sheet(views: &[PosedView]) -> Array3<u8> {
    let shapes = views.iter().map(|view| view.camera.height as f64 / view.camera.width as f64);
    let height = ((THUMBNAIL as f64 * shapes.fold(0.0, f64::max)).ceil() as usize).clamp(1, 4 * THUMBNAIL);
    let text = text_height(THUMBNAIL);
    let cell = [THUMBNAIL + MARGIN, height + text + 2 * MARGIN];
    let (columns, rows) = (views.len().clamp(1, COLUMNS), views.len().div_ceil(COLUMNS));
    let mut canvas = Canvas::new(columns * cell[0] + MARGIN, rows * cell[1] + MARGIN, BACKGROUND);
    for (index, view) in views.iter().enumerate() {
        let [left, top] = [MARGIN + index % COLUMNS * cell[0], MARGIN + index / COLUMNS * cell[1]];
        let title = if index == 0 { "original".to_owned() } else { format!("view {index:02}") };
        canvas.text(&title, [left, top], text, INK);
        canvas.image([left, top + text + MARGIN / 2], &shrink(masked(view).view(), (height, THUMBNAIL)));
    }
    canvas.pixels
}

fn masked(view: &PosedView) -> Array3<f32> {
    let mut image = view.image.to_owned();
    Zip::from(image.lanes_mut(Axis(2))).and(&view.mask).for_each(|mut colour, &real| {
        if !real {
            colour.iter_mut().zip([1.0, 0.0, 0.0]).for_each(|(c, red)| *c = 0.4 * *c + 0.6 * red);
        }
    });
    image
}

/// A colour bar with three labels below it.
fn colour_bar(
    canvas: &mut Canvas,
    [left, top]: [usize; 2],
    width: usize,
    colours: &Colours,
    [low, high]: [f64; 2],
    text: usize,
) {
    let steps = width.max(2) - 1;
    canvas.paint([left, top], [width, BAR], |x, _| colours.at(x as f64 / steps as f64));
    // Both functions of a value are their own inverse.
    let middle = (colours.of)(0.5 * ((colours.of)(low) + (colours.of)(high)));
    for (share, value) in [(0.0, low), (0.5, middle), (1.0, high)] {
        let label = number(value, high - low);
        let start = share * (width as f64 - text_width(&label, text) as f64).max(0.0);
        canvas.text(&label, [left + start as usize, top + BAR + MARGIN / 2], text, INK);
    }
}

/// With the digits that the range needs.
fn number(value: f64, range: f64) -> String {
    let digits = if range > 0.0 { (2.0 - range.log10().floor()).clamp(0.0, 6.0) as usize } else { 3 };
    format!("{value:.digits$}")
}

fn known(value: f32) -> bool {
    value.is_finite() && value > 0.0
}

/// 1 % and 99 % of the known values.
pub fn usual_range<'v>(values: impl Iterator<Item = &'v f32>) -> [f64; 2] {
    let mut values: Vec<f32> = values.copied().filter(|&v| known(v)).collect();
    [0.01, 0.99].map(|p| quantile(&mut values, p).unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::files::Beside;
    use mde_prior::format::DepthPng;
    use mde_uncertainty::GaussianDepth;
    use mde_warp::PinholeCamera;

    fn colours(picture: &Array3<u8>, at: (usize, usize)) -> Colour {
        [0, 1, 2].map(|c| picture[(at.0, at.1, c)])
    }

    /// A preview of 30 x 300 pixels with the depth as its own prior.
    fn shown(depth: &Array2<f32>, sigma: f32, photographs: &[f32]) -> Array3<u8> {
        let image = |&grey: &f32| Array3::from_elem((30, 300, 3), grey).into_shared();
        let images: Vec<_> = photographs.iter().map(image).collect();
        let refined = GaussianDepth::new(depth.clone(), depth.mapv(|_| 1.0)).unwrap();
        let camera = PinholeCamera::from_fov(60.0, 300, 30).unwrap();
        let (sigma, png) = (Array2::from_elem((30, 300), sigma), DepthPng::new("m", depth.iter().copied()));
        preview(&ResultFiles {
            depth: &refined,
            sigma: sigma.view(),
            prior: depth.view(),
            image: images[0].view(),
            camera,
            png,
            beside: Beside {
                strip: strip(&images, 300),
                truth: Some(depth.view()),
                evidence: vec![("confirmed", sigma.view())],
                ..Beside::default()
            },
        })
    }

    #[test]
    fn equal_depths_look_equal_in_both_panels_and_missing_ones_grey() {
        let mut depth = Array2::from_shape_fn((30, 300), |(_, x)| 1.0 + x as f32 / 100.0);
        depth[(10, 20)] = 0.0;
        let canvas = shown(&depth, f32::INFINITY, &[0.5]);
        let (top, left) = (2 * MARGIN + text_height(300), |panel: usize| MARGIN + panel * (300 + MARGIN));
        for (y, x) in [(3, 2), (20, 150), (29, 299)] {
            assert_eq!(colours(&canvas, (top + y, left(1) + x)), colours(&canvas, (top + y, left(2) + x)));
            assert_ne!(colours(&canvas, (top + y, left(1) + x)), MISSING);
            assert_eq!(colours(&canvas, (top + y, left(3) + x)), MISSING);
        }
        assert_eq!(colours(&canvas, (top + 10, left(1) + 20)), MISSING);
        assert_eq!(colours(&canvas, (top + 10, left(0) + 20)), [128; 3]);
    }

    #[test]
    fn several_photographs_are_shown_above_with_the_truth_for_the_image() {
        let depth = Array2::from_shape_fn((30, 300), |(_, x)| 1.0 + x as f32 / 100.0);
        let [one, two] = [&[0.5][..], &[0.5, 1.0]].map(|photographs| shown(&depth, 0.1, photographs));
        let added = two.dim().0 - one.dim().0;
        assert!(added > 30 && one.dim().1 == two.dim().1, "{added}");
        let (top, middle) = (2 * MARGIN + text_height(300), two.dim().1 / 2);
        assert_eq!(colours(&two, (top + 5, middle - 60)), [128; 3]);
        assert_eq!(colours(&two, (top + 5, middle + 60)), [255; 3]);
        // The prior takes the image's place, and the truth is between refined and sigma.
        let row = added + top + 10;
        let panel = |index: usize| colours(&two, (row, MARGIN + index * (300 + MARGIN) + 100));
        assert_eq!((panel(0), panel(1)), (panel(1), panel(2)));
        assert_ne!(panel(2), panel(3));
    }

    /// Of one photograph there is no strip, and the truth is not shown.
    #[test]
    fn the_photographs_that_confirm_a_pixel_take_the_place_of_a_flat_prior() {
        let canvas = shown(&Array2::from_elem((30, 300), 2.0), 4.0, &[0.5]);
        let row = 2 * MARGIN + text_height(300) + 10;
        let panel = |index: usize| colours(&canvas, (row, MARGIN + index * (300 + MARGIN) + 100));
        // Sigma is twice the depth, and the count the largest there is: both have the last colour.
        assert_eq!((panel(0), panel(1), panel(2)), ([128; 3], DEPTHS.at(0.5), OTHERS.at(1.0)));
        assert_eq!(panel(3), panel(2));
    }

    #[test]
    fn a_range_leaves_out_the_extremes_and_the_missing() {
        let mut values: Vec<f32> = (1..=1000).map(|v| v as f32).collect();
        values.extend([0.0, f32::INFINITY, -3.0]);
        let [low, high] = usual_range(values.iter());
        assert!((low - 10.99).abs() < 1e-9 && (high - 990.01).abs() < 1e-9, "{low} {high}");
        assert_eq!(usual_range([].iter()), [0.0, 0.0]);
        assert_eq!((number(1.23456, 4.0), number(0.0123, 0.02)), ("1.23".to_owned(), "0.0123".to_owned()));
    }
}
