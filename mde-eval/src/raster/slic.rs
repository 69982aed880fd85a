use crate::Result;
use crate::raster::{Map, Mask};
use ndarray::Array2;

/// Superpixels of a map: the segment of each pixel, and where the segments' centres are.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Superpixels {
    /// Segment of each pixel `[height, width]`, counted from 0; nothing where it is masked out.
    pub(crate) labels: Array2<Option<u32>>,
    /// Centre of each segment: row and column of its mean place, rounded; nothing where no pixel is left.
    pub(crate) centres: Vec<Option<(usize, usize)>>,
}

impl Superpixels {
    /// SLIC (Achanta et al., PAMI 2012) of one channel, without its last step (joining fragments): about `count` segments that
    /// start on a grid of side \\(S\\); each pixel goes to the nearest of the nine centres around it by
    ///
    /// \\[ (v - v_k)^2 + \left(\tfrac{m}{S}\right)^2 \\|x - x_k\\|^2, \\]
    ///
    /// centres move to the mean of their pixels, `iterations` times. `map` is `[height, width]`, best scaled to 0 to 100 as
    /// lightness is; `compactness` is \\(m\\). Pixels outside the mask belong to no segment.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) where the mask differs.
    pub(crate) fn slic(
        map: Map<'_>,
        mask: Mask<'_>,
        count: usize,
        compactness: f64,
        iterations: usize,
    ) -> Result<Self> {
        super::same_shape("the mask", mask.dim(), map.dim())?;
        let (height, width) = map.dim();
        let side = ((height * width) as f64 / count as f64).sqrt().max(1.0);
        let (rows, columns) = ((height as f64 / side).ceil() as usize, (width as f64 / side).ceil() as usize);
        let mut labels = Array2::from_shape_fn((height, width), |(y, x)| {
            let cell = |at: usize, of: usize| ((at as f64 / side) as usize).min(of.saturating_sub(1));
            mask[(y, x)].then(|| (cell(y, rows) * columns + cell(x, columns)) as u32)
        });
        let weight = ((compactness / side).powi(2)) as f32;
        let mut means = means(map, &labels, rows * columns);
        for _ in 0..iterations {
            for ((y, x), label) in labels.indexed_iter_mut() {
                let Some(label) = label else { continue };
                let (row, column) = ((y as f64 / side) as usize, (x as f64 / side) as usize);
                let mut best = f32::INFINITY;
                for r in row.saturating_sub(1)..(row + 2).min(rows) {
                    for c in column.saturating_sub(1)..(column + 2).min(columns) {
                        let Some([v, my, mx]) = means[r * columns + c] else { continue };
                        let (dy, dx) = (y as f32 - my, x as f32 - mx);
                        let distance = (map[(y, x)] - v).powi(2) + weight * (dy * dy + dx * dx);
                        if distance < best {
                            (best, *label) = (distance, (r * columns + c) as u32);
                        }
                    }
                }
            }
            means = self::means(map, &labels, rows * columns);
        }
        let place = |mean: &Option<[f32; 3]>| {
            let [_, y, x] = (*mean)?;
            let at = ((y + 0.5) as usize, (x + 0.5) as usize);
            (at.0 < height && at.1 < width).then_some(at)
        };
        Ok(Self { centres: means.iter().map(place).collect(), labels })
    }

    /// Pairs of segments that touch over an edge of a pixel, the smaller first, each once.
    pub(crate) fn neighbours(&self) -> Vec<(u32, u32)> {
        let mut pairs = Vec::new();
        for ((y, x), label) in self.labels.indexed_iter() {
            for other in [(y + 1, x), (y, x + 1)] {
                if let (Some(a), Some(Some(b))) = (label, self.labels.get(other))
                    && a != b
                {
                    pairs.push((*a.min(b), *a.max(b)));
                }
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }
}

/// Mean value, row and column of each segment.
fn means(map: Map<'_>, labels: &Array2<Option<u32>>, count: usize) -> Vec<Option<[f32; 3]>> {
    let mut sums = vec![[0.0_f64; 4]; count];
    for ((y, x), label) in labels.indexed_iter() {
        if let Some(sum) = label.and_then(|label| sums.get_mut(label as usize)) {
            let terms = [f64::from(map[(y, x)]), y as f64, x as f64, 1.0];
            sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
    }
    sums.into_iter().map(|[v, y, x, n]| (n > 0.0).then(|| [v / n, y / n, x / n].map(|m| m as f32))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_map_stays_a_grid_and_a_step_is_followed() {
        let mask = Array2::from_elem((40, 60), true);
        let flat = Superpixels::slic(Array2::zeros((40, 60)).view(), mask.view(), 24, 20.0, 5).unwrap();
        assert_eq!(flat.centres.len(), 24);
        assert_eq!(flat.neighbours().len(), 4 * 5 + 3 * 6);
        let step = Array2::from_shape_fn((40, 60), |(_, x)| if x < 27 { 0.0 } else { 100.0 });
        let cut = Superpixels::slic(step.view(), mask.view(), 24, 10.0, 5).unwrap();
        for y in 0..40 {
            assert_ne!(cut.labels[(y, 26)], cut.labels[(y, 27)]);
        }
    }

    #[test]
    fn masked_pixels_have_no_segment() {
        let mask = Array2::from_shape_fn((20, 20), |(y, _)| y > 9);
        let found = Superpixels::slic(Array2::ones((20, 20)).view(), mask.view(), 16, 20.0, 3).unwrap();
        assert!(found.labels.indexed_iter().all(|((y, _), label)| label.is_some() == (y > 9)));
        assert!(Superpixels::slic(Array2::ones((2, 2)).view(), mask.view(), 4, 20.0, 2).is_err());
    }
}
